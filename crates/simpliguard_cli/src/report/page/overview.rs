//! The table over all models: one body for each level, the worst models first.

use std::collections::BTreeMap;

use super::figures::{COSTS, Figure, LIKENESS, SECONDS, WARNINGS, mean};
use super::text::{escaped, models};
use crate::levels::Of;
use crate::report::asset::{Asset, LevelKey, Measured, MeasuredLevel};

/// A row of a level: a model that has it.
struct Row<'a> {
    /// Number of the model on the page.
    number: usize,
    asset: &'a Asset,
    model: &'a Measured,
    level: &'a MeasuredLevel,
}

/// The order of the models: failed ones, then by likeness from the worst on, then those without levels.
pub(super) fn worst_first(assets: &[Asset]) -> Vec<usize> {
    let rank = |asset: &Asset| match &asset.result {
        Err(_) => f64::NEG_INFINITY,
        Ok(model) => model.worst_psnr().unwrap_or(f64::INFINITY),
    };
    let mut order: Vec<usize> = (0..assets.len()).collect();
    order.sort_by(|&a, &b| rank(&assets[a]).total_cmp(&rank(&assets[b])));
    order
}

fn columns() -> Vec<&'static Figure> {
    COSTS.iter().chain([&SECONDS]).chain(&LIKENESS).chain([&WARNINGS]).collect()
}

/// The table.
pub(super) fn overview(assets: &[Asset], order: &[usize], levels: &BTreeMap<LevelKey, &str>) -> String {
    let button = |(number, name): (usize, &&str)| {
        format!("<button type=\"button\" value=\"{number}\" aria-pressed=\"false\">{name}</button>")
    };
    let buttons: String = (1..).zip(levels.values()).map(button).collect();
    let heading = |figure: &&Figure| {
        let (title, help) = (figure.title, escaped(figure.help));
        format!("<th scope=\"col\" data-sort title=\"{help}\"><button type=\"button\">{title}</button></th>")
    };
    let headings: String = columns().iter().map(heading).collect();
    let body = |(number, (key, name)): (usize, (&LevelKey, &&str))| body(assets, order, (number, *key, name));
    let mut bodies: String = (1..).zip(levels).map(body).collect();
    if levels.is_empty() {
        bodies = body((1, (&(Of::Model, 1), &"LOD1")));
    }
    format!(
        "<section id=\"overview\"><h2>All models</h2>\n<div class=\"levels tabs\" hidden>{buttons}</div>\n\
         <div class=\"scroll\"><table><thead><tr>\
         <th scope=\"col\" data-sort><button type=\"button\">Model</button></th>{headings}</tr></thead>\n{bodies}</table></div>\n\
         <button type=\"button\" class=\"more\" hidden></button></section>\n"
    )
}

/// The body of a level: its number on the page, its key and its name.
fn body(assets: &[Asset], order: &[usize], (body, key, level): (usize, LevelKey, &str)) -> String {
    let row = |number: usize| {
        let asset = &assets[number];
        let model = asset.result.as_ref().ok()?;
        Some(Row { number, asset, model, level: model.level(key)? })
    };
    let mut rows: Vec<Row<'_>> = order.iter().filter_map(|&number| row(number)).collect();
    let rank = |row: &Row<'_>| row.level.psnr().unwrap_or(row.level.comparison.lit.psnr);
    rows.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
    let span = columns().len();
    let mut html = format!(
        "<tbody data-level=\"{body}\"><tr class=\"title\"><th scope=\"rowgroup\" colspan=\"{}\">{level}</th></tr>\n",
        span + 1
    );
    for &number in order {
        let text = match &assets[number].result {
            Err(error) => format!("failed: {error}"),
            Ok(model) if model.levels.is_empty() && body == 1 => format!("{}: no levels", model.status_text()),
            Ok(_) => continue,
        };
        let (name, text) = (name_cell(number, &assets[number]), escaped(&text));
        html += &format!("<tr class=\"other\">{name}<td colspan=\"{span}\">{text}</td></tr>\n");
    }
    html.extend(rows.iter().map(Row::html));
    html + &mean_row(&rows) + "</tbody>\n"
}

fn name_cell(number: usize, asset: &Asset) -> String {
    let (name, label) = (escaped(&asset.name), escaped(&asset.label));
    format!("<th scope=\"row\" data-value=\"{label}\"><a href=\"#asset-{number}\" title=\"{name}\">{label}</a></th>")
}

impl Row<'_> {
    fn html(&self) -> String {
        let cell = |figure: &&Figure| {
            let (value, source) = figure.of(self.model, self.level);
            let sort = value.map(|value| value.to_string()).unwrap_or_default();
            format!("<td data-value=\"{sort}\">{}{}</td>", figure.text_of(value), of_source(figure, source))
        };
        let cells: String = columns().iter().map(cell).collect();
        format!("<tr>{}{cells}</tr>\n", name_cell(self.number, self.asset))
    }
}

/// The means over the models that have the level. A figure that a model does not have is in no mean.
fn mean_row(rows: &[Row<'_>]) -> String {
    let cell = |figure: &&Figure| {
        let values: Vec<_> = rows.iter().map(|row| figure.of(row.model, row.level)).collect();
        let value = mean(values.iter().filter_map(|(value, _)| *value));
        let source = mean(values.iter().filter_map(|(_, source)| *source));
        let missing = values.iter().filter(|(value, _)| value.is_none()).count();
        let without = if missing > 0 { format!("<small>without {missing}</small>") } else { String::new() };
        format!("<td>{}{}{without}</td>", figure.text_of(value), of_source(figure, source))
    };
    let cells: String = columns().iter().map(cell).collect();
    format!("<tr class=\"mean\"><th scope=\"row\">Mean of {}</th>{cells}</tr>\n", models(rows.len()))
}

/// The source's figure below that of the level.
fn of_source(figure: &Figure, source: Option<f64>) -> String {
    source.map_or_else(String::new, |source| format!("<small>of {}</small>", (figure.text)(source)))
}
