//! Reads the imports between the files of a crate from its `use` lines and its paths.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Stands for a path into another crate.
const OTHER_CRATE: &str = "::";

/// The files of a crate and the names that they import.
pub(crate) struct Crate {
    pub(crate) name: String,
    /// By module path, such as `["pipeline", "store"]`.
    modules: BTreeMap<Vec<String>, Module>,
}

struct Module {
    /// Relative to `src`.
    file: String,
    /// Paths from the crate's root, with the names under which a `pub use` passes them on.
    uses: Vec<Use>,
}

struct Use {
    path: Vec<String>,
    name: String,
    is_public: bool,
}

impl Crate {
    /// Reads all files below `src` except those of tests.
    pub(crate) fn read(src: &Path) -> Self {
        let name = src.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let mut modules = BTreeMap::new();
        read_folder(src, src, &mut modules);
        Self { name, modules }
    }

    /// Pairs of files of which the first imports the second. A name is followed to the file that defines it.
    pub(crate) fn imports(&self) -> BTreeSet<(String, String)> {
        let mut out = BTreeSet::new();
        for module in self.modules.values() {
            for import in &module.uses {
                let target = self.file_of(&import.path, 0);
                out.extend(target.filter(|to| **to != module.file).map(|to| (module.file.clone(), to.clone())));
            }
        }
        out
    }

    /// The file that defines the item of a path; `None` if another crate does.
    fn file_of(&self, path: &[String], depth: usize) -> Option<&String> {
        if path.first().is_some_and(|first| first == OTHER_CRATE) {
            return None;
        }
        let longest = (0..=path.len()).rev().find(|n| self.modules.contains_key(&path[..*n]))?;
        let module = &self.modules[&path[..longest]];
        let Some(item) = path.get(longest) else {
            return Some(&module.file);
        };
        // Names that the module passes on come from another file.
        let passed_on = module.uses.iter().find(|u| u.is_public && u.name == *item && depth < 8);
        passed_on.map_or(Some(&module.file), |u| self.file_of(&u.path, depth + 1))
    }
}

fn read_folder(src: &Path, folder: &Path, modules: &mut BTreeMap<Vec<String>, Module>) {
    for entry in std::fs::read_dir(folder).expect("lists") {
        let path = entry.expect("lists").path();
        let relative = path.strip_prefix(src).expect("below").to_string_lossy().replace('\\', "/");
        let is_test = relative.split('/').any(|part| part.trim_end_matches(".rs").ends_with("tests"));
        if is_test {
            continue;
        }
        if path.is_dir() {
            read_folder(src, &path, modules);
        } else if let Some(stem) = relative.strip_suffix(".rs") {
            let mut module: Vec<String> = stem.split('/').map(str::to_owned).collect();
            if module
                .last()
                .is_some_and(|last| last == "mod" || (module.len() == 1 && (last == "lib" || last == "main")))
            {
                module.pop();
            }
            let text = std::fs::read_to_string(&path).expect("reads");
            let uses = uses(&without_tests_and_comments(&text), &module);
            modules.insert(module, Module { file: relative, uses });
        }
    }
}

/// The code without comments and without what is compiled for tests alone, which stands at the end of a file.
fn without_tests_and_comments(text: &str) -> String {
    let lines = text.lines().take_while(|line| *line != "#[cfg(test)]" || !text.contains("mod tests {"));
    // A visibility such as `pub(in crate::refine)` imports nothing.
    let code = |line: &str| line.split("//").next().unwrap_or_default().replace("(in crate::", "(in ");
    lines.map(code).collect::<Vec<_>>().join("\n")
}

/// Paths below `crate`, `self` and `super`, and those of `use` lines that begin with a child of the module.
fn uses(code: &str, module: &[String]) -> Vec<Use> {
    let children: BTreeSet<&str> = code
        .lines()
        .filter_map(|line| {
            let words: Vec<&str> = line.trim().trim_end_matches(';').split_whitespace().collect();
            let at = words.iter().position(|word| *word == "mod")?;
            words.get(at + 1).copied()
        })
        .collect();
    let mut out = Vec::new();
    let mut statements = code.split(';');
    for statement in &mut statements {
        let line_start = statement.rfind('\n').map_or(0, |_| 0);
        let trimmed = statement[line_start..].trim_start_matches(|c: char| c.is_whitespace() || c == '}');
        let (is_public, tree) = match trimmed.find("use ") {
            Some(at) if trimmed[..at].trim().is_empty() || trimmed[..at].trim_start().starts_with("pub") => {
                (at > 0, &trimmed[at + 4..])
            }
            _ => continue,
        };
        for (path, name) in leaves(tree) {
            let path = absolute(&path, module, &children).unwrap_or_else(|| vec![OTHER_CRATE.to_owned()]);
            out.push(Use { path, name, is_public });
        }
    }
    for word in code.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')) {
        // A list in braces is read with its `use`.
        let is_path = word.starts_with("crate::") || word.starts_with("super::");
        if is_path && !word.ends_with("::") {
            let path: Vec<String> = word.split("::").map(str::to_owned).collect();
            let name = path.last().cloned().unwrap_or_default();
            let absolute = absolute(&path, module, &children);
            out.extend(absolute.map(|path| Use { path, name, is_public: false }));
        }
    }
    out
}

/// A path from the crate's root; `None` if it leads to another crate.
fn absolute(path: &[String], module: &[String], children: &BTreeSet<&str>) -> Option<Vec<String>> {
    let first = path.first()?.as_str();
    let rest = |n: usize| path[n..].iter().cloned();
    match first {
        "crate" => Some(rest(1).collect()),
        "self" => Some(module.iter().cloned().chain(rest(1)).collect()),
        "super" => {
            let ups = path.iter().take_while(|segment| *segment == "super").count();
            let base = module.len().checked_sub(ups)?;
            Some(module[..base].iter().cloned().chain(rest(ups)).collect())
        }
        first if children.contains(first) => Some(module.iter().cloned().chain(rest(0)).collect()),
        _ => None,
    }
}

/// The paths of a `use` tree and the names they get.
fn leaves(tree: &str) -> Vec<(Vec<String>, String)> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
        let mut path: Vec<String> = path.split("::").map(|s| s.trim().to_owned()).collect();
        if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
            path.pop();
        }
        let name = if alias.is_empty() { path.last().cloned().unwrap_or_default() } else { alias.trim().to_owned() };
        return vec![(path, name)];
    };
    let prefix: Vec<String> = tree[..open]
        .trim_end_matches("::")
        .split("::")
        .filter(|s| !s.is_empty())
        .map(|s| s.trim().to_owned())
        .collect();
    let body = &tree[open + 1..tree.rfind('}').unwrap_or(tree.len())];
    let mut out = Vec::new();
    let (mut depth, mut start) = (0, 0);
    let bounds = body.char_indices().filter_map(|(i, c)| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        (c == ',' && depth == 0).then_some(i)
    });
    for end in bounds.chain([body.len()]).collect::<Vec<_>>() {
        let part = body[start..end].trim();
        start = (end + 1).min(body.len());
        for (path, name) in leaves(part).into_iter().filter(|_| !part.is_empty()) {
            let full: Vec<String> = prefix.iter().cloned().chain(path).collect();
            let full = if full.last().is_some_and(|last| last == "self") { prefix.clone() } else { full };
            out.push((full, name));
        }
    }
    out
}
