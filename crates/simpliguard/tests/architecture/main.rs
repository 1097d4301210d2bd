//! The architecture that ARCHITECTURE.md describes: imports run down only, and no two files import each other.

mod imports;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use imports::Crate;
use simpliguard::{STAGES, Stage};

/// Folders of this crate from the bottom to the top. Folders of one row do not import each other.
const LAYERS: [&[&str]; 7] = [
    &["data"],
    &["geometry"],
    &["animation"],
    &["render"],
    &["gltf", "reconstruct", "simplify", "skinning", "unwrap", "texture", "refine"],
    &["settings"],
    &["pipeline"],
];

/// What every folder may use of the crate's root.
const ROOT: [&str; 5] = ["cancellation", "error", "source", "lib", "StageId"];

fn crates() -> Vec<Crate> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a folder of crates");
    let entries = std::fs::read_dir(folder).expect("lists").map(|entry| entry.expect("lists").path().join("src"));
    let mut roots: Vec<PathBuf> = entries.filter(|src| src.is_dir()).collect();
    roots.sort();
    roots.iter().map(|src| Crate::read(src)).collect()
}

#[test]
fn the_table_of_stages_is_current() {
    const ARCHITECTURE: &str = include_str!("../../../../ARCHITECTURE.md");
    let row = |stage: &Stage| {
        let Stage { id, version, purpose, weight, per_level } = stage;
        let runs = if *per_level { "for each level" } else { "once" };
        format!("| `{id}` | {version} | {runs} | {weight} % | {purpose} |\n")
    };
    let table: String = STAGES.iter().map(row).collect();
    assert!(ARCHITECTURE.contains(&table), "the table of stages in ARCHITECTURE.md should read:\n{table}");
}

#[test]
fn imports_run_down_only() {
    let own = Crate::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
    let layer = |folder: &str| LAYERS.iter().position(|row| row.contains(&folder));
    let mut wrong = BTreeSet::new();
    for (from, to) in own.imports() {
        let [a, b] = [&from, &to].map(|file| file.split('/').next().unwrap_or_default().trim_end_matches(".rs"));
        let (Some(above), Some(below)) = (layer(a), layer(b)) else {
            // The root's own files are used by all and use nothing but each other.
            if layer(b).is_none() && !ROOT.contains(&b) {
                wrong.insert(format!("{from} imports {to}, which belongs to no layer"));
            }
            if layer(a).is_none() && layer(b).is_some() && a != "lib" {
                wrong.insert(format!("{from} imports {to}, which lies above the root"));
            }
            continue;
        };
        let is_settings = b == "settings" && a != "settings" && a != "pipeline";
        if a != b && (above <= below || is_settings) {
            wrong.insert(format!("{from} imports {to}"));
        }
    }
    assert!(wrong.is_empty(), "imports that do not run down:\n{}", Vec::from_iter(wrong).join("\n"));
}

#[test]
fn no_files_import_each_other() {
    let mut circles = Vec::new();
    for krate in crates() {
        let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (from, to) in krate.imports() {
            graph.entry(from).or_default().insert(to);
        }
        circles.extend(circle(&graph).map(|files| format!("{}: {}", krate.name, files.join(" -> "))));
    }
    assert!(circles.is_empty(), "circles of imports:\n{}", circles.join("\n"));
}

/// Some circle of a graph, if it has one.
fn circle(graph: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<String>> {
    fn visit<'a>(
        file: &'a str,
        graph: &'a BTreeMap<String, BTreeSet<String>>,
        (done, path): (&mut BTreeSet<&'a str>, &mut Vec<&'a str>),
    ) -> bool {
        if let Some(start) = path.iter().position(|f| *f == file) {
            path.drain(..start);
            path.push(file);
            return true;
        }
        if done.contains(file) {
            return false;
        }
        path.push(file);
        for next in graph.get(file).into_iter().flatten() {
            if visit(next, graph, (done, path)) {
                return true;
            }
        }
        path.pop();
        done.insert(file);
        false
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|file| {
        let mut path = Vec::new();
        visit(file, graph, (&mut done, &mut path)).then(|| path.iter().map(|f| (*f).to_owned()).collect())
    })
}

#[test]
fn the_readers_of_imports_see_circles() {
    let graph = |edges: &[(&str, &str)]| {
        let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (from, to) in edges {
            graph.entry((*from).to_owned()).or_default().insert((*to).to_owned());
        }
        graph
    };
    assert_eq!(circle(&graph(&[("a", "b"), ("b", "c"), ("c", "b")])), Some(vec!["b".into(), "c".into(), "b".into()]));
    assert_eq!(circle(&graph(&[("a", "b"), ("b", "c"), ("a", "c")])), None);
}
