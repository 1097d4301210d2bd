//! The documentation says what the code does, and its links lead somewhere.

use std::collections::BTreeSet;
use std::path::Path;

use bevy::reflect::structs::Struct;
use bevy_simpliguard::{LodSettings, SimpliguardLods};
use simpliguard::settings::{FieldInfo, ProjectFile, parse_meta, reference};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

const README: &str = include_str!("../../README.md");
const BEVY: &str = include_str!("../../docs/bevy.md");
const SETTINGS: &str = include_str!("../../docs/settings.md");

const MANIFEST: &str = include_str!("../../Cargo.toml");
const MINIMAL: &str = include_str!("../../examples/minimal.rs");
const PLUGIN: &str = include_str!("../../crates/bevy_simpliguard/src/lib.rs");

/// Most bytes of the README: what is longer goes to `docs/`.
const LONGEST_README: usize = 10_000;

/// A page of the documentation.
struct Page {
    /// Relative to the repository's root, its parts separated by `/`.
    path: String,
    text: String,
}

impl Page {
    fn read(path: String) -> Self {
        let text = std::fs::read_to_string(Path::new(ROOT).join(&path)).unwrap_or_else(|e| panic!("{path}: {e}"));
        Self { path, text }
    }

    /// Its code blocks in a language, without the indentation of a list.
    fn blocks(&self, language: &str) -> Vec<String> {
        let mut blocks = Vec::new();
        let mut lines = self.text.lines();
        while let Some(line) = lines.next() {
            let indentation = line.len() - line.trim_start().len();
            if let Some(opened) = line.trim().strip_prefix("```") {
                let block = lines.by_ref().take_while(|line| line.trim() != "```");
                let block = block.map(|line| line.get(indentation..).unwrap_or_default().to_owned() + "\n").collect();
                if opened == language {
                    blocks.push(block);
                }
            }
        }
        blocks
    }

    /// Its lines outside of code blocks.
    fn prose(&self) -> impl Iterator<Item = &str> {
        let mut in_code = false;
        self.text.lines().filter(move |line| {
            let fence = line.trim_start().starts_with("```");
            in_code ^= fence;
            !in_code && !fence
        })
    }

    /// The anchors of its headings, as GitHub names them.
    fn anchors(&self) -> BTreeSet<String> {
        let mut anchors = BTreeSet::new();
        for line in self.prose() {
            let title = line.trim_start_matches('#');
            let level = line.len() - title.len();
            if !(1..=6).contains(&level) || !title.starts_with(' ') {
                continue;
            }
            let anchor = anchor(title.trim());
            // Later headings of one name are numbered.
            let numbered = (1..).map(|n| format!("{anchor}-{n}"));
            let free = std::iter::once(anchor.clone()).chain(numbered).find(|name| !anchors.contains(name));
            anchors.extend(free);
        }
        anchors
    }

    /// The targets of its links and images that are no web addresses.
    fn links(&self) -> Vec<String> {
        let targets = self.prose().flat_map(|line| {
            let line = without_code(line);
            let parts: Vec<String> = line.split("](").skip(1).map(str::to_owned).collect();
            parts.into_iter().filter_map(|part| part.split_once(')').map(|(target, _)| target.to_owned()))
        });
        targets.filter(|target| !target.contains("://") && !target.starts_with("mailto:")).collect()
    }
}

/// A line without what stands between backticks.
fn without_code(line: &str) -> String {
    line.split('`').step_by(2).collect()
}

/// The anchor of a heading: lower case, without punctuation, with `-` for spaces.
fn anchor(title: &str) -> String {
    let kept = title.to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The Markdown files of a folder, whose path is empty for the root or ends in `/`.
fn pages_in(folder: &str) -> Vec<Page> {
    let entries = std::fs::read_dir(Path::new(ROOT).join(folder)).expect("a folder");
    let names = entries.map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".md")).collect();
    names.sort();
    names.into_iter().map(|name| Page::read(format!("{folder}{name}"))).collect()
}

/// The README, its neighbours and everything in `docs/`.
fn pages() -> Vec<Page> {
    let pages: Vec<Page> = pages_in("").into_iter().chain(pages_in("docs/")).collect();
    let paths: Vec<&str> = pages.iter().map(|page| page.path.as_str()).collect();
    for path in ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "docs/bevy.md", "docs/settings.md"] {
        assert!(paths.contains(&path), "{path} is not among {paths:?}");
    }
    pages
}

/// Where a link of a page leads: a path from the repository's root, and an anchor or nothing.
fn resolve(page: &str, link: &str) -> (String, String) {
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    if file.is_empty() {
        return (page.to_owned(), anchor.to_owned());
    }
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in file.split('/') {
        match part {
            "" | "." => {}
            ".." => assert!(parts.pop().is_some(), "{page}: {link} leaves the repository"),
            part => parts.push(part),
        }
    }
    (parts.join("/"), anchor.to_owned())
}

/// A row of the table of settings.
fn row(field: &FieldInfo) -> String {
    let [draft, standard, best] = &field.defaults;
    let default =
        if field.is_preset() { format!("`{draft}` / `{standard}` / `{best}`") } else { format!("`{standard}`") };
    format!("| `{}` | {default} | {} | {} |", field.name, field.accepts, field.doc)
}

#[test]
fn the_readme_is_short() {
    assert!(README.len() <= LONGEST_README, "{} of at most {LONGEST_README} bytes", README.len());
}

#[test]
fn every_link_leads_to_a_file_and_a_heading() {
    let mut count = 0;
    for page in pages() {
        for link in page.links() {
            let (target, anchor) = resolve(&page.path, &link);
            assert!(Path::new(ROOT).join(&target).exists(), "{}: there is no {target} ({link})", page.path);
            if !anchor.is_empty() {
                let anchors = Page::read(target).anchors();
                assert!(anchors.contains(&anchor), "{}: {link} is none of {anchors:?}", page.path);
            }
            count += 1;
        }
    }
    assert!(count > 30, "{count}");
}

#[test]
fn headings_are_named_as_github_does() {
    assert_eq!(anchor("Golden tests and PIPELINE_VERSION"), "golden-tests-and-pipeline_version");
    assert_eq!(anchor("How a setting travels: `view_size`"), "how-a-setting-travels-view_size");
    let text = "# A\n\n## B c\n\n```sh\n# no heading\n```\n\n## B c\n[`x`](y.md#z) `[a](b)` [e](http://f)\n".to_owned();
    let page = Page { path: "docs/a.md".into(), text };
    assert_eq!(page.anchors().into_iter().collect::<Vec<_>>(), ["a", "b-c", "b-c-1"]);
    assert_eq!(page.links(), ["y.md#z"]);
    assert_eq!(resolve("docs/a.md", "../README.md#b"), ("README.md".into(), "b".into()));
    assert_eq!(resolve("docs/a.md", "#b"), ("docs/a.md".into(), "b".into()));
}

#[test]
fn the_table_of_settings_is_complete_and_current() {
    let table: Vec<String> = reference().iter().map(row).collect();
    let missing = table.iter().any(|row| !SETTINGS.lines().any(|line| line == row));
    assert!(!missing, "the table of docs/settings.md should read:\n{}", table.join("\n"));
    let rows = SETTINGS.lines().filter(|line| line.starts_with("| `")).count();
    assert_eq!(rows, table.len(), "docs/settings.md has rows of fields that are gone");
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
    // The metrics and the GPU are the command's alone.
    for name in optimised.filter(|name| !["simpliguard_eval", "simpliguard_gpu"].contains(name)) {
        assert!(README.contains(&format!("\n{name}.opt-level = 3\n")), "{name}");
        count += 1;
    }
    assert!(count > 5, "{count}");
}

#[test]
fn settings_files_are_valid() {
    let (mut metas, mut projects) = (0, 0);
    for page in pages() {
        for block in page.blocks("ron") {
            if block.contains("meta_format_version") {
                let settings = parse_meta(&block, &page.path).unwrap_or_else(|error| panic!("{error}\n{block}"));
                assert!(settings.is_some(), "{}: it is for the plugin's processor\n{block}", page.path);
                metas += 1;
            } else {
                ProjectFile::parse(&block, &page.path).unwrap_or_else(|error| panic!("{error}\n{block}"));
                projects += 1;
            }
        }
    }
    assert!(metas > 0 && projects > 2, "{metas} {projects}");
}

/// Tests of the plugin's crate compile what is marked as Rust in the pages that it includes.
#[test]
fn rust_is_compiled_and_nothing_is_run() {
    let mut count = 0;
    for page in pages() {
        assert!(page.blocks("rust").is_empty(), "{}: rust blocks are `rust,no_run`", page.path);
        let blocks = page.blocks("rust,no_run").len();
        let included = PLUGIN.contains(&format!("include_str!(\"../../../{}\")", page.path));
        assert!(blocks == 0 || included, "{}: no test compiles its code", page.path);
        count += blocks;
    }
    assert!(count > 2, "{count}");
}

#[test]
fn the_tables_of_lod_settings_are_complete_and_current() {
    let tables: [&dyn Struct; 2] = [&LodSettings::default(), &SimpliguardLods::default()];
    for table in tables {
        for field in 0..table.field_len() {
            let (name, value) = (table.name_at(field), table.field_at(field));
            let row = format!("| `{}` | `{:?}` | ", name.expect("a field"), value.expect("a field"));
            assert!(BEVY.contains(&row), "docs/bevy.md should have a row {row}");
        }
    }
}

#[test]
fn every_example_is_listed() {
    let examples = std::fs::read_dir(Path::new(ROOT).join("examples")).expect("a folder");
    let names = examples.map(|entry| entry.expect("readable").path().file_stem().map(|s| s.display().to_string()));
    // The package's own program, and what several examples use.
    let others = ["showcase", "shared"];
    for name in names.map(|name| name.expect("a name")).filter(|name| !others.contains(&name.as_str())) {
        assert!(BEVY.contains(&format!("| `{name}` | ")), "docs/bevy.md should list the example {name}");
    }
}
