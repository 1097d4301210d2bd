//! The page: one HTML document with everything in it.

mod figures;
mod objects;
mod overview;
mod section;
mod text;

use std::collections::BTreeMap;

use serde::Serialize;
use simpliguard::{PIPELINE_VERSION, content_hash};

use self::figures::{COSTS, Figure, Value};
use self::overview::{overview, worst_first};
use self::section::{saving, section};
use self::text::json_in_script;
use super::asset::{Asset, LevelKey, Measured};

/// The scripts of the page; `viewer/build.mjs` makes them from `viewer/src`.
const SCRIPT: &str = include_str!("../viewer/viewer.js");
const STYLE: &str = include_str!("page.css");

/// Version of the JSON document in the page. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

/// Bytes of a page besides its models and pictures: the scripts, and some room for tables.
pub(super) const FIXED_BYTES: u64 = SCRIPT.len() as u64 + STYLE.len() as u64 + 400_000;

/// What the page is made of.
pub(super) struct Page<'a> {
    pub(super) assets: &'a [Asset],
    /// Views of the figures.
    pub(super) views: u16,
}

/// The JSON document in the page.
#[derive(Serialize)]
struct Document<'a> {
    version: u32,
    pipeline_version: &'static str,
    views: u16,
    assets: Vec<Entry<'a>>,
}

#[derive(Serialize)]
struct Entry<'a> {
    name: &'a str,
    error: Option<&'a str>,
    #[serde(flatten)]
    model: Option<&'a Measured>,
}

impl<'a> Entry<'a> {
    fn of(asset: &'a Asset) -> Self {
        let result = asset.result.as_ref();
        Self { name: &asset.name, error: result.err().map(String::as_str), model: result.ok() }
    }
}

impl Page<'_> {
    /// The HTML document. It loads nothing: the policy allows only its own scripts and styles, and images within it.
    pub(super) fn html(&self) -> String {
        let order = worst_first(self.assets);
        let json = self.json();
        // Nobody who writes a name into a model can know the hash of the figures beside it.
        let nonce = content_hash(json.as_bytes()).to_string();
        let policy = format!(
            "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data: blob:; \
             connect-src data: blob:; base-uri 'none'; form-action 'none'"
        );
        let mut html = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>simpliguard report</title>\n\
             <link rel=\"icon\" href=\"data:,\">\n<style nonce=\"{nonce}\">\n{STYLE}</style>\n</head>\n<body>\n"
        );
        html += &self.header();
        let measured = self.assets.iter().filter_map(|asset| asset.result.as_ref().ok());
        html += &overview(self.assets, &order, &level_names(measured));
        html += "<section id=\"models\"><h2>Each model</h2>\n";
        let first = order.iter().position(|&number| self.assets[number].result.is_ok());
        for (place, &number) in order.iter().enumerate() {
            html += &section(number, &self.assets[number], Some(place) == first);
        }
        html += "</section>\n";
        html += &format!("<script type=\"application/json\" id=\"report\">{}</script>\n", json_in_script(&json));
        html + &format!("<script nonce=\"{nonce}\">\n{SCRIPT}</script>\n</body>\n</html>\n")
    }

    /// The figures of all models as JSON.
    fn json(&self) -> String {
        let assets = self.assets.iter().map(Entry::of).collect();
        let document =
            Document { version: DOCUMENT_VERSION, pipeline_version: PIPELINE_VERSION, views: self.views, assets };
        // Strings, numbers and lists always have a JSON form.
        serde_json::to_string(&document).unwrap_or_default()
    }

    fn header(&self) -> String {
        let models = self.assets.iter().filter_map(|asset| asset.result.as_ref().ok());
        let models: Vec<&Measured> = models.collect();
        let cached = models.iter().filter(|model| model.cached).count();
        let failed = self.assets.len() - models.len();
        let failed = if failed == 0 { String::new() } else { format!(", <strong>{failed} failed</strong>") };
        format!(
            "<header><h1>simpliguard report</h1>\n<p>{}, {cached} from the cache{failed}. Pipeline version \
             {PIPELINE_VERSION}. Figures over {} views.</p>\n{}</header>\n",
            text::models(self.assets.len()),
            self.views,
            savings(&models)
        )
    }
}

/// The names of all levels that models have.
fn level_names<'a>(models: impl Iterator<Item = &'a Measured>) -> BTreeMap<LevelKey, &'a str> {
    models.flat_map(|model| &model.levels).map(|level| (level.key(), level.name.as_str())).collect()
}

/// The costs of all models together: at each level, of those that have it.
fn savings(models: &[&Measured]) -> String {
    let levels = level_names(models.iter().copied());
    if levels.is_empty() {
        return String::new();
    }
    let headings: String = COSTS.iter().map(|figure| format!("<th scope=\"col\">{}</th>", figure.title)).collect();
    let row = |(&key, name): (&LevelKey, &&str)| {
        let with: Vec<_> = models.iter().filter_map(|model| Some((*model, model.level(key)?))).collect();
        let cell = |figure: &Figure| {
            let Value::Cost(cost) = figure.value else { return String::new() };
            let source = with.iter().map(|(model, _)| cost(&model.source)).sum::<u64>() as f64;
            let level = with.iter().map(|(_, level)| cost(&level.cost)).sum::<u64>() as f64;
            let (text, change) = ((figure.text)(level), saving(Some(level), Some(source)));
            format!("<td>{text}<small>of {}</small>{change}</td>", (figure.text)(source))
        };
        let cells: String = COSTS.iter().map(cell).collect();
        let of = text::models(with.len());
        format!("<tr><th scope=\"row\">{name}<small>{of}</small></th>{cells}</tr>\n")
    };
    let rows: String = levels.iter().rev().map(row).collect();
    format!(
        "<div class=\"scroll\"><table class=\"savings\"><caption>What the levels of all models cost together</caption>\
         <thead><tr><th scope=\"col\"></th>{headings}</tr></thead>\n<tbody>{rows}</tbody></table></div>\n"
    )
}

#[cfg(test)]
mod tests;
