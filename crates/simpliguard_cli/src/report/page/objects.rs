//! The table of the kinds of objects of a scene.

use super::text::{count, escaped, percent, two};
use crate::report::objects::{ObjectKind, ObjectLevel};

/// A column of a level: its title, its value, and that as text.
type Column = (&'static str, fn(&ObjectLevel) -> Option<f64>, fn(f64) -> String);

const COLUMNS: [Column; 3] = [
    ("triangles", |level| level.triangles.map(|triangles| triangles as f64), count),
    ("deviation %", |level| level.deviation, percent),
    ("PSNR", |level| level.psnr, two),
];

/// The table; nothing without objects. A script sorts it by a click on a heading.
pub(super) fn objects(kinds: &[ObjectKind]) -> String {
    if kinds.is_empty() {
        return String::new();
    }
    let levels = kinds.iter().flat_map(|kind| &kind.levels).map(|level| level.level).max().unwrap_or(0);
    let of_levels = (1..=levels).flat_map(|level| COLUMNS.map(|(title, ..)| format!("LOD{level} {title}")));
    let titles = ["Object", "Instances", "Triangles"].map(str::to_owned).into_iter().chain(of_levels);
    let heading = |title: String| format!("<th scope=\"col\" data-sort><button type=\"button\">{title}</button></th>");
    let headings: String = titles.map(heading).collect();
    let rows: String = kinds.iter().map(|kind| row(kind, levels)).collect();
    let instances: u64 = kinds.iter().map(|kind| kind.instances).sum();
    format!(
        "<h4>Objects</h4>\n<p class=\"hint\">{} kinds of objects with {} instances. Triangles are those of one instance. \
         Deviation and PSNR are those of the bake, of each object alone.</p>\n\
         <div class=\"scroll objects\"><table class=\"sorted\"><thead><tr>{headings}<th scope=\"col\" class=\"text\">Warnings</th>\
         </tr></thead>\n<tbody>{rows}</tbody></table></div>\n",
        count(kinds.len() as f64),
        count(instances as f64),
    )
}

fn row(kind: &ObjectKind, levels: u64) -> String {
    let level = |number: u64| kind.levels.iter().find(|level| level.level == number);
    let of_level = |number| COLUMNS.map(|(_, value, text)| cell(level(number).and_then(value), text));
    let cells: String = (1..=levels).flat_map(of_level).collect();
    let warnings = kind.levels.iter().filter_map(|level| level.warning.as_deref());
    let warnings: String = warnings.map(|warning| format!("<small>{}</small>", escaped(warning))).collect();
    let (name, triangles) = (escaped(&kind.name), kind.triangles.map(|triangles| triangles as f64));
    format!(
        "<tr><th scope=\"row\" data-value=\"{name}\">{name}</th>{}{}{cells}<td class=\"text\">{warnings}</td></tr>\n",
        cell(Some(kind.instances as f64), count),
        cell(triangles, count),
    )
}

/// A number, with its value to sort by.
fn cell(value: Option<f64>, text: fn(f64) -> String) -> String {
    let sort = value.map(|value| value.to_string()).unwrap_or_default();
    format!("<td data-value=\"{sort}\">{}</td>", value.map_or_else(|| "–".to_owned(), text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_has_a_row_with_the_figures_of_its_levels() {
        let level = |level, psnr, warning: Option<&str>| ObjectLevel {
            level,
            triangles: Some(1000 * level),
            deviation: Some(0.0125),
            psnr,
            warning: warning.map(str::to_owned),
        };
        let kind = |name: &str, levels| ObjectKind { name: name.into(), instances: 3, triangles: Some(8000), levels };
        let levels = vec![level(1, Some(20.5), Some("it is <bad>")), level(2, None, None)];
        let html = objects(&[kind("<Chair>", levels), kind("Box", Vec::new())]);
        assert!(html.contains("2 kinds of objects with 6 instances"), "{html}");
        let row = "<tr><th scope=\"row\" data-value=\"&lt;Chair&gt;\">&lt;Chair&gt;</th><td data-value=\"3\">3</td>\
                   <td data-value=\"8000\">8,000</td><td data-value=\"1000\">1,000</td><td data-value=\"0.0125\">1.25</td>\
                   <td data-value=\"20.5\">20.50</td><td data-value=\"2000\">2,000</td><td data-value=\"0.0125\">1.25</td>\
                   <td data-value=\"\">–</td><td class=\"text\"><small>it is &lt;bad&gt;</small></td></tr>";
        assert!(html.contains(row), "{html}");
        assert_eq!((html.matches("<td data-value=\"\">–</td>").count(), html.matches("data-sort").count()), (7, 9));
        assert_eq!(objects(&[]), "");
    }
}
