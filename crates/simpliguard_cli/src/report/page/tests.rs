use simpliguard::Status;
use simpliguard_eval::compare::{Comparison, ImageMetrics};

use super::super::asset::{Cost, MeasuredLevel};
use super::*;
use crate::levels::Of;

fn level(number: u64, psnr: f64) -> MeasuredLevel {
    let unlit = ImageMetrics { psnr, ..ImageMetrics::default() };
    let lit = ImageMetrics { psnr: psnr.min(30.0) - 10.0, ..ImageMetrics::default() };
    let comparison = Comparison {
        faces: 8,
        unlit,
        lit,
        perceptual: None,
        silhouette_iou: 0.9,
        iou_3d: None,
        distances: None,
        motion: None,
    };
    let cost = Cost { triangles: 8, draw_calls: 1, texture_memory: 4000, mesh_memory: 50, bytes: 100 };
    let name = format!("LOD{number}");
    MeasuredLevel { name, of: Of::Model, level: number, deviation: Some(0.25), report: None, cost, comparison }
}

fn asset(name: &str, levels: &[f64]) -> Asset {
    let measured = Measured {
        status: Status::Baked,
        cached: false,
        seconds_total: 2.5,
        seconds: vec![("simplify".into(), 1.5), ("refine".into(), 1.0)],
        notes: vec!["a <note>".into()],
        settings: Vec::new(),
        file_bytes: 7,
        source: Cost { triangles: 1000, draw_calls: 5, texture_memory: 8000, mesh_memory: 500, bytes: 90_000 },
        levels: (1..).zip(levels).map(|(number, psnr)| level(number, *psnr)).collect(),
        objects: Vec::new(),
        preview: None,
        models: None,
        sheets: Vec::new(),
    };
    Asset { name: name.into(), label: name.into(), result: Ok(measured) }
}

fn html(assets: &[Asset]) -> String {
    Page { assets, views: 20 }.html()
}

/// The names of the models in the order of the table's body for LOD1.
fn order(assets: &[Asset]) -> Vec<String> {
    let html = html(assets);
    let body =
        html.split("<tbody data-level=\"1\">").nth(1).expect("a body").split("</tbody>").next().expect("its end");
    let rows = body.split("<th scope=\"row\" data-value=\"").skip(1);
    rows.map(|row| row.split('"').next().expect("a name").to_owned()).collect()
}

#[test]
fn the_worst_stand_first_and_white_models_by_their_lit_pictures() {
    let failed = Asset { name: "failed".into(), label: "failed".into(), result: Err("why".into()) };
    let assets = [asset("good", &[40.0]), asset("white", &[100.0]), asset("bad", &[25.0]), failed, asset("none", &[])];
    assert_eq!(order(&assets), ["failed", "none", "white", "bad", "good"]);
    assert_eq!(worst_first(&assets), [3, 1, 2, 0, 4]);
}

#[test]
fn pictures_that_say_nothing_are_in_no_mean() {
    let html = html(&[asset("a", &[20.0]), asset("b", &[30.0]), asset("white", &[100.0])]);
    let mean = html.split("<tr class=\"mean\">").nth(1).expect("a mean").split("</tr>").next().expect("its end");
    assert!(mean.contains("Mean of 3 models") && mean.contains("<td>25.00<small>without 1</small></td>"), "{mean}");
    assert!(mean.contains("<td>8<small>of 1,000</small></td>"), "{mean}");
}

#[test]
fn the_page_embeds_the_bundle_that_is_checked_in_and_loads_nothing() {
    let html = html(&[asset("a", &[20.0])]);
    assert!(SCRIPT.len() < 1_000_000 && html.contains(SCRIPT));
    assert!(!SCRIPT.contains("</script") && !SCRIPT.contains("<!--"));
    let own = html.replace(SCRIPT, "");
    for outside in ["http:", "https:", " src=\"/", "@import", "url("] {
        assert!(!own.contains(outside), "{outside}");
    }
    assert!(own.contains("content=\"default-src 'none'; script-src 'nonce-"));
}

#[test]
fn hostile_names_stay_text() {
    let name = "</script><script>alert(1)</script>\"'>.glb";
    let html = html(&[asset(name, &[20.0]), Asset { name: name.into(), label: name.into(), result: Err(name.into()) }]);
    assert!(!html.contains("<script>") && !html.contains("alert(1)<"), "markup from a name");
    let json = html.split("id=\"report\">").nth(1).expect("the figures").split("</script>").next().expect("its end");
    let figures: serde_json::Value = serde_json::from_str(json).expect("JSON");
    assert_eq!((&figures["assets"][0]["name"], &figures["assets"][1]["error"]), (&name.into(), &name.into()));
    assert_eq!(figures["assets"][0]["levels"][0]["cost"]["triangles"], 8);
}

#[test]
fn levels_that_stand_for_different_things_are_not_mixed() {
    let mut scene = asset("scene", &[22.0]);
    let level = &mut scene.result.as_mut().expect("measured").levels[0];
    (level.name, level.of) = ("whole LOD1".into(), Of::Whole);
    let html = html(&[asset("a", &[20.0]), scene]);
    for part in ["value=\"1\" aria-pressed=\"false\">LOD1<", "value=\"2\" aria-pressed=\"false\">whole LOD1<"] {
        assert!(html.contains(part), "{part}");
    }
    let body = |number: usize| html.split("<tbody data-level=").nth(number).expect("a body").split("</tbody>").next();
    let names =
        [1, 2].map(|number| body(number).map(|body| ["a", "scene"].map(|name| body.contains(&format!(">{name}</a>")))));
    assert_eq!(names, [Some([true, false]), Some([false, true])]);
    assert_eq!(html.matches("<small>1 model</small>").count(), 2);
}

#[test]
fn the_costs_of_all_models_are_summed() {
    let html = html(&[asset("a", &[20.0, 30.0]), asset("b", &[30.0])]);
    let table =
        html.split("<table class=\"savings\">").nth(1).expect("a table").split("</table>").next().expect("its end");
    assert!(table.contains("<td>16<small>of 2,000</small><small>−99.2 %</small></td>"), "{table}");
    assert!(table.contains("LOD2<small>1 model</small>") && table.contains("<td>8<small>of 1,000</small>"), "{table}");
}
