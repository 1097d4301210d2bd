//! The README says what the code does.

use simpliguard::settings::{FieldInfo, reference};

const README: &str = include_str!("../../README.md");

const MANIFEST: &str = include_str!("../../Cargo.toml");
const MINIMAL: &str = include_str!("../../examples/minimal.rs");

/// A row of the table of settings.
fn row(field: &FieldInfo) -> String {
    let [draft, standard, best] = &field.defaults;
    let default =
        if field.is_preset() { format!("`{draft}` / `{standard}` / `{best}`") } else { format!("`{standard}`") };
    format!("| `{}` | {default} | {} | {} |", field.name, field.accepts, field.doc)
}

#[test]
fn the_table_of_settings_is_complete_and_current() {
    let table: Vec<String> = reference().iter().map(row).collect();
    let missing = table.iter().any(|row| !README.lines().any(|line| line == row));
    assert!(!missing, "the README's table of settings should read:\n{}", table.join("\n"));
}

#[test]
fn the_quick_start_is_the_minimal_example() {
    let code = MINIMAL.split_once("\n\n").expect("a heading and code").1;
    assert!(README.contains(code), "the README's src/main.rs should read:\n{code}");
}

#[test]
fn the_quick_start_optimises_what_this_workspace_optimises() {
    let sections = MANIFEST.split("\n[profile.dev.package.").skip(1);
    let optimised = sections.filter_map(|section| section.split_once("]\nopt-level = 3").map(|(name, _)| name));
    let mut count = 0;
    // The metrics are the command's alone.
    for name in optimised.filter(|name| *name != "simpliguard_eval") {
        assert!(README.contains(&format!("\n{name}.opt-level = 3\n")), "{name}");
        count += 1;
    }
    assert!(count > 5, "{count}");
}
