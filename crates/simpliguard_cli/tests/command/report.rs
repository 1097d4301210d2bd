//! The page of a report.

use std::fs;

use crate::bake::QUICK;
use crate::folder::{Folder, Run, sphere, triangle};

fn report(folder: &Folder, args: &[&str]) -> Run {
    folder.run(&[&["report", "--views", "2"], args, &QUICK].concat())
}

fn page(folder: &Folder, name: &str) -> String {
    fs::read_to_string(folder.path(name)).expect("a page")
}

/// The JSON document in a page.
fn figures(page: &str) -> serde_json::Value {
    let json = page.split("<script type=\"application/json\" id=\"report\">").nth(1).expect("the figures");
    serde_json::from_str(json.split("</script>").next().expect("its end")).expect("JSON")
}

#[test]
fn the_page_has_models_figures_pictures_and_settings() {
    let folder = Folder::new().with("in/<i>ball.glb", sphere(24)).with("in/small.glb", triangle());
    let args = ["in", "--faces", "100,200"];
    let run = report(&folder, &args);
    assert_eq!(run.code, 0, "{}", run.stderr);
    run.says("wrote report.html");
    let html = page(&folder, "report.html");
    for part in [
        "Content-Security-Policy",
        ">&lt;i&gt;ball.glb</h3>",
        "id=\"overview\"",
        "<tbody data-level=\"2\">",
        "small enough: no levels",
        "data-models=\"models-0\"",
        "data-sheet=\"heat\"",
        "src=\"data:image/jpeg;base64,",
        "<th scope=\"row\">texture_size</th><td class=\"text\"><code>64</code></td><td class=\"text\">command line</td>",
        "<th scope=\"row\">simplify</th>",
    ] {
        assert!(html.contains(part), "'{part}' is not in the page");
    }
    assert!(!html.contains("<i>"), "a name is markup");
    let ball = &figures(&html)["assets"][0];
    assert_eq!((&ball["status"], &ball["cached"]), (&"baked".into(), &false.into()));
    assert_eq!((&ball["source"]["triangles"], &ball["source"]["draw_calls"]), (&1128.into(), &1.into()));
    assert_eq!((&ball["levels"][1]["level"], &ball["levels"][1]["cost"]["draw_calls"]), (&2.into(), &1.into()));
    let psnr = |level: usize| ball["levels"][level]["comparison"]["lit"]["psnr"].as_f64().expect("a figure");
    assert!(psnr(0) > 5.0 && psnr(1) > psnr(0), "{ball}");

    // A bake with these settings made the same result.
    let again = report(&folder, &[&args[..], &["--out", "out/again.html"]].concat());
    assert_eq!(again.code, 0, "{}", again.stderr);
    assert_eq!(figures(&page(&folder, "out/again.html"))["assets"][0]["cached"], true);
}

#[test]
fn a_model_that_fails_is_shown_with_its_cause() {
    let folder = Folder::new().with("in/bad.glb", "glTF").with("in/small.glb", triangle());
    let run = report(&folder, &["in", "--out", "page.html"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let html = page(&folder, "page.html");
    assert!(html.contains("<strong>1 failed</strong>") && html.contains("in/bad.glb: import: "), "{}", run.stderr);
    assert!(figures(&html)["assets"][0]["error"].is_string());
}

#[test]
fn a_page_that_cannot_be_written_is_a_usage_error() {
    let folder = Folder::new().with("small.glb", triangle()).with("file", "");
    let run = report(&folder, &["small.glb", "--out", "file/page.html"]);
    assert_eq!(run.code, 2, "{}", run.stderr);
    run.says("cannot write file/page.html");
    assert_eq!(report(&folder, &["small.glb", "--max-size", "much"]).code, 2);
}
