//! The part of the page about one model.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::figures::{ALL_LIKENESS, COSTS, Figure};
use super::objects::objects;
use super::text::{count, escaped, two};
use crate::report::asset::{Asset, Measured, MeasuredLevel, Sheet};

/// The names of the sheets on their buttons, and what they show.
const SHEETS: [(&str, &str, &str); 3] = [
    ("unlit", "Unlit", "Base colour alone."),
    ("lit", "Lit", "Under a lamp at the camera."),
    ("heat", "Heat map", "The FLIP error of each pixel without light, from black (none) to yellow (1)."),
];
/// Width of the longest bar of the seconds.
const BAR: f64 = 240.0;

/// The section of a model.
pub(super) fn section(number: usize, asset: &Asset, is_open: bool) -> String {
    let open = if is_open { " open" } else { "" };
    let (badge, body) = match &asset.result {
        Err(error) => ("failed", format!("<p class=\"error\">{}</p>\n", escaped(error))),
        Ok(model) => (model.status_text(), body(number, model)),
    };
    let (name, label) = (escaped(&asset.name), escaped(&asset.label));
    format!(
        "<details class=\"asset\" name=\"asset\" id=\"asset-{number}\"{open}><summary><h3 title=\"{name}\">{label}</h3> \
         <span class=\"badge\">{badge}</span></summary>\n{body}</details>\n"
    )
}

fn body(number: usize, model: &Measured) -> String {
    let parts = [
        view(number, model),
        notes(&model.notes),
        figures(model),
        objects(&model.objects),
        sheets(model),
        seconds(model),
        settings(model),
    ];
    parts.concat()
}

fn notes(notes: &[String]) -> String {
    if notes.is_empty() {
        return String::new();
    }
    let items: String = notes.iter().map(|note| format!("<li>{}</li>", escaped(note))).collect();
    format!("<h4>Notes</h4>\n<ul class=\"notes\">{items}</ul>\n")
}

/// The 3-D view, which a script fills.
fn view(number: usize, model: &Measured) -> String {
    let (Some(made), Some(glb)) = (model.preview, &model.models) else {
        return "<p class=\"message\">There is no 3-D view of this model.</p>\n".to_owned();
    };
    let texels = |side: Option<u32>| {
        side.map_or_else(
            || "as in the file".to_owned(),
            |side| format!("at most {} texels wide", count(f64::from(side))),
        )
    };
    let faces = model.source.triangles;
    // The bake leaves out triangles without an area, which the view has.
    let shown = count(faces.min(made.triangles as u64) as f64);
    let levels = match model.levels.is_empty() {
        true => String::new(),
        false => {
            format!(" The levels have the geometry of the bake; their textures are {}.", texels(made.level_texture))
        }
    };
    let whole = count(faces as f64);
    let textures = texels(made.source_texture);
    let (part, data) = (if made.triangles as u64 >= faces { "the" } else { "a preview of the" }, STANDARD.encode(glb));
    format!(
        "<div class=\"view\" data-models=\"models-{number}\" data-faces=\"{faces}\">\n\
         <div class=\"stage\"><div class=\"canvas\"></div><span class=\"source-label\"></span>\
         <span class=\"level-label\"></span><p class=\"message\"></p></div>\n{CONTROLS}</div>\n\
         <p class=\"hint\">The view shows {part} source with {shown} of {whole} triangles, its textures {textures}.{levels} \
         Figures and pictures are those of the whole models.</p>\n\
         <script type=\"application/octet-stream+base64\" id=\"models-{number}\">{data}</script>\n"
    )
}

/// The controls of a view.
const CONTROLS: &str = "<form class=\"controls\" hidden>\
<label>Level <input type=\"range\" name=\"level\" min=\"1\" max=\"1\" step=\"1\"> <output></output></label>\
<label><input type=\"checkbox\" name=\"lit\" checked> lit</label>\
<label><input type=\"checkbox\" name=\"wireframe\"> wireframe</label>\
<label><input type=\"checkbox\" name=\"heat\"> difference</label>\
<label><input type=\"checkbox\" name=\"turn\"> turn</label>\
<label>Clip <select name=\"clip\"></select></label>\
<label><input type=\"checkbox\" name=\"play\" checked> play</label>\
</form>\n";

/// The table of the source and its levels.
fn figures(model: &Measured) -> String {
    let heading = |figure: &Figure| {
        let (title, help) = (figure.title, escaped(figure.help));
        format!("<th scope=\"col\" title=\"{help}\">{title}</th>")
    };
    let headings: String = COSTS.iter().chain(&ALL_LIKENESS).map(heading).collect();
    let cost = |figure: &Figure| {
        let value = match figure.value {
            super::figures::Value::Cost(cost) => Some(cost(&model.source) as f64),
            _ => None,
        };
        format!("<td>{}</td>", figure.text_of(value))
    };
    let source: String = COSTS.iter().map(cost).chain(ALL_LIKENESS.iter().map(|_| "<td></td>".to_owned())).collect();
    let levels: String = model.levels.iter().rev().map(|level| level_row(model, level)).collect();
    format!(
        "<h4>Figures</h4>\n<div class=\"scroll\"><table><thead><tr><th scope=\"col\"></th>{headings}\
         <th scope=\"col\">Candidate</th></tr></thead>\n\
         <tbody><tr><th scope=\"row\">Source</th>{source}<td></td></tr>\n{levels}</tbody></table></div>\n"
    )
}

fn level_row(model: &Measured, level: &MeasuredLevel) -> String {
    let cell = |figure: &Figure| {
        let (value, source) = figure.of(model, level);
        format!("<td>{}{}</td>", figure.text_of(value), saving(value, source))
    };
    let cells: String = COSTS.iter().chain(&ALL_LIKENESS).map(cell).collect();
    let (name, report) = (&level.name, level.report.as_ref());
    let candidate = report.map(|report| escaped(&report.candidate)).unwrap_or_default();
    let stopped = report.and_then(|report| report.stopped.as_deref());
    let stopped = stopped.map(|reason| format!("<small>{}</small>", escaped(reason))).unwrap_or_default();
    format!("<tr><th scope=\"row\">{name}</th>{cells}<td class=\"text\">{candidate}{stopped}</td></tr>\n")
}

/// What a level saves of its source's cost.
pub(super) fn saving(level: Option<f64>, source: Option<f64>) -> String {
    match (level, source) {
        (Some(level), Some(source)) if source > 0.0 && level != source => {
            let change = 100.0 * (level / source - 1.0);
            let (sign, digits) =
                (if change < 0.0 { "−" } else { "+" }, usize::from(change.abs() > 99.0 && change < 0.0));
            format!("<small>{sign}{:.digits$} %</small>", change.abs())
        }
        _ => String::new(),
    }
}

/// The pictures. Without scripts, all sheets are shown.
fn sheets(model: &Measured) -> String {
    if model.sheets.is_empty() {
        return String::new();
    }
    let button =
        |(name, title, _): &(&str, &str, &str)| format!("<button type=\"button\" value=\"{name}\">{title}</button>");
    let buttons: String = SHEETS.iter().map(button).collect();
    let names = model.levels.iter().rev().map(|level| format!("<span>{}</span>", level.name));
    let labels: String = std::iter::once("<span>Source</span>".to_owned()).chain(names).collect();
    let figures: String = model.sheets.iter().map(|sheet| picture(sheet, &labels)).collect();
    format!("<h4>Pictures</h4>\n<div class=\"sheets\"><div class=\"tabs\" hidden>{buttons}</div>\n{figures}</div>\n")
}

fn picture(sheet: &Sheet, labels: &str) -> String {
    let (_, title, help) = SHEETS.iter().find(|(name, ..)| *name == sheet.name).unwrap_or(&SHEETS[0]);
    let ([width, height], data) = (sheet.size, STANDARD.encode(&sheet.jpeg));
    format!(
        "<figure data-sheet=\"{}\"><figcaption>{title}: {help}</figcaption><div class=\"scroll\"><div class=\"sheet\">\
         <div class=\"labels\">{labels}</div><img loading=\"lazy\" decoding=\"async\" width=\"{width}\" height=\"{height}\" \
         alt=\"{title}: the source and its levels from four sides\" src=\"data:image/jpeg;base64,{data}\"></div></div></figure>\n",
        sheet.name
    )
}

/// Seconds of the stages as bars.
fn seconds(model: &Measured) -> String {
    let total = two(model.seconds_total);
    if model.seconds.is_empty() {
        return format!("<h4>Time</h4>\n<p>{}, in {total} s. No stage ran.</p>\n", sentence(model.status_text()));
    }
    let longest = model.seconds.iter().map(|(_, time)| *time).fold(f64::MIN_POSITIVE, f64::max);
    let bar = |(stage, time): &(String, f64)| {
        let (stage, text, width) = (escaped(stage), two(*time), (BAR * time / longest).max(1.0));
        format!(
            "<tr><th scope=\"row\">{stage}</th><td>{text}</td><td class=\"text\"><svg width=\"{BAR}\" height=\"12\" \
             aria-hidden=\"true\"><rect width=\"{width:.1}\" height=\"12\"/></svg></td></tr>\n"
        )
    };
    let bars: String = model.seconds.iter().map(bar).collect();
    format!(
        "<h4>Time</h4>\n<p>{total} s in all. Levels run beside each other, so the stages may sum to more.</p>\n\
         <div class=\"scroll\"><table class=\"bars\"><tbody>{bars}</tbody></table></div>\n"
    )
}

fn sentence(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map(|first| first.to_uppercase().chain(chars).collect()).unwrap_or_default()
}

/// The settings: those that somebody has set, and all of them folded.
fn settings(model: &Measured) -> String {
    let row = |setting: &crate::report::asset::Setting| {
        let (value, origin) = (escaped(&setting.value), escaped(&setting.origin));
        format!(
            "<tr><th scope=\"row\">{}</th><td class=\"text\"><code>{value}</code></td><td class=\"text\">{origin}</td></tr>\n",
            setting.name
        )
    };
    let rows: String = model.settings.iter().map(row).collect();
    format!(
        "<details class=\"settings\"><summary><h4>Settings</h4></summary><div class=\"scroll\"><table><thead><tr>\
         <th scope=\"col\">Setting</th><th scope=\"col\" class=\"text\">Value</th><th scope=\"col\" class=\"text\">Origin</th>\
         </tr></thead>\n<tbody>{rows}</tbody></table></div></details>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn savings_are_relative_to_the_source() {
        let found = |level, source| saving(Some(level), Some(source));
        assert_eq!(found(1000.0, 95_000.0), "<small>−98.9 %</small>".replace("98.9", "99"));
        assert_eq!(found(1.0, 1000.0), "<small>−99.9 %</small>");
        assert_eq!(found(3.0, 2.0), "<small>+50 %</small>");
        assert_eq!(found(2.0, 2.0) + &found(2.0, 0.0) + &saving(None, Some(1.0)), "");
    }

    #[test]
    fn a_failed_model_shows_its_cause_as_text() {
        let asset =
            Asset { name: "<b>.glb".into(), label: "<b>.glb".into(), result: Err("import: '</script>' & more".into()) };
        let html = section(3, &asset, true);
        assert!(html.contains("id=\"asset-3\" open>") && html.contains(">&lt;b&gt;.glb</h3>"), "{html}");
        assert!(html.contains("import: &#39;&lt;/script&gt;&#39; &amp; more"), "{html}");
    }
}
