//! The README says what the code does.

use bevy::reflect::structs::Struct;
use bevy_simpliguard::{LodSettings, SimpliguardLods};
use simpliguard::settings::{FieldInfo, ProjectFile, parse_meta, reference};

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

/// Code blocks in this language, without the indentation of a list.
fn blocks(language: &str) -> Vec<String> {
    let mut blocks = Vec::new();
    let mut lines = README.lines();
    while let Some(line) = lines.next() {
        let indentation = line.len() - line.trim_start().len();
        if line.trim() == format!("```{language}") {
            let block = lines.by_ref().take_while(|line| line.trim() != "```");
            blocks.push(block.map(|line| line.get(indentation..).unwrap_or_default().to_owned() + "\n").collect());
        }
    }
    blocks
}

#[test]
fn settings_files_are_valid() {
    let blocks = blocks("ron");
    let (metas, projects): (Vec<_>, Vec<_>) = blocks.iter().partition(|block| block.contains("meta_format_version"));
    assert!(!metas.is_empty() && projects.len() > 1, "{blocks:?}");
    for project in projects {
        ProjectFile::parse(project, "README.md").unwrap_or_else(|error| panic!("{error}\n{project}"));
    }
    for meta in metas {
        let settings = parse_meta(meta, "README.md").unwrap_or_else(|error| panic!("{error}\n{meta}"));
        assert!(settings.is_some(), "it is for the plugin's processor\n{meta}");
    }
}

/// The README's own tests compile what is marked as Rust.
#[test]
fn rust_is_compiled_and_nothing_is_run() {
    assert!(blocks("rust").is_empty() && blocks("rust,no_run").len() > 2);
}

#[test]
fn the_tables_of_lod_settings_are_complete_and_current() {
    let tables: [&dyn Struct; 2] = [&LodSettings::default(), &SimpliguardLods::default()];
    for table in tables {
        for field in 0..table.field_len() {
            let (name, value) = (table.name_at(field), table.field_at(field));
            let row = format!("| `{}` | `{:?}` | ", name.expect("a field"), value.expect("a field"));
            assert!(README.contains(&row), "the README should have a row {row}");
        }
    }
}

#[test]
fn every_example_is_listed() {
    let examples = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/examples")).expect("a folder");
    let names = examples.map(|entry| entry.expect("readable").path().file_stem().map(|s| s.display().to_string()));
    // The package's own program, and what several examples use.
    let others = ["showcase", "shared"];
    for name in names.map(|name| name.expect("a name")).filter(|name| !others.contains(&name.as_str())) {
        assert!(README.contains(&format!("`{name}`")) || README.contains(&format!("--example {name}`")), "{name}");
    }
}
