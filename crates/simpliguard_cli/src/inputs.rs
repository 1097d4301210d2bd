//! Inputs: the models that the paths on the command line stand for.

use std::path::{Component, Path, PathBuf};

use walkdir::{DirEntry, WalkDir};

use crate::boundary::Boundary;
use crate::console;
use crate::error::UsageError;
use crate::pattern::Pattern;
use crate::project::nearest_project;
use crate::source::{is_gltf, read_text};

/// A model, and the place of its result.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Input {
    /// The path as given, or below a folder as given.
    pub(crate) path: PathBuf,
    /// Path of the result, below the output folder, without extension.
    pub(crate) below: PathBuf,
}

/// The models of a command line: files as given, and all models below each folder in the order of their paths. Files
/// need not exist. A path with wildcards that names no file stands for what it matches. Links out of a folder and its
/// project are not followed; `project` is that of the command line.
pub(crate) fn find(inputs: &[PathBuf], output: &Path, project: Option<&Path>) -> Result<Vec<Input>, UsageError> {
    let mut found = Vec::new();
    for input in inputs {
        for path in expand(input)? {
            if path.is_dir() {
                found.extend(models_in(&path, output, project)?);
            } else {
                let below = path.file_name().map(PathBuf::from).unwrap_or_default().with_extension("");
                found.push(Input { path, below });
            }
        }
    }
    Ok(found)
}

/// The models of a text file with one path a line, relative to `root`. Empty lines count for nothing.
pub(crate) fn listed(list: &Path, root: &Path) -> Result<Vec<Input>, UsageError> {
    let text = read_text(list)
        .map_err(|e| UsageError(format!("--files-from: cannot read {}: {e}; check the path", list.display())))?;
    let input = |line: &str| {
        let path = Path::new(line);
        let stays = path.components().all(|part| matches!(part, Component::Normal(_)));
        let below = if stays { path } else { path.file_name().map_or(path, Path::new) };
        Input { path: root.join(path), below: below.with_extension("") }
    };
    Ok(text.lines().filter(|line| !line.is_empty()).map(input).collect())
}

/// The paths that an argument stands for.
fn expand(input: &Path) -> Result<Vec<PathBuf>, UsageError> {
    let failed = |found: String| UsageError(format!("{}: {found}", input.display()));
    // A name may have brackets.
    let is_there = input.symlink_metadata().is_ok();
    let pattern = if is_there { None } else { Pattern::parse(input, cfg!(windows)).map_err(failed)? };
    let Some(pattern) = pattern else { return Ok(vec![input.to_owned()]) };
    let found = pattern.find();
    if found.is_empty() { Err(failed("no .glb or .gltf file and no folder matches".into())) } else { Ok(found) }
}

fn models_in(folder: &Path, output: &Path, project: Option<&Path>) -> Result<Vec<Input>, UsageError> {
    let models = search(folder, output, project);
    if models.is_empty() {
        return Err(UsageError(format!("{}: there is no .glb or .gltf file below this folder", folder.display())));
    }
    Ok(models)
}

/// All models below a folder, in the order of their paths.
fn search(folder: &Path, output: &Path, project: Option<&Path>) -> Vec<Input> {
    let output = output.canonicalize().ok();
    let nearest = folder.canonicalize().ok().and_then(|folder| nearest_project(&folder.join("model")));
    let boundary = Boundary::of(folder, project.or(nearest.as_deref()));
    let wanted = |entry: &DirEntry| {
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        let is_output = || output.is_some() && entry.path().canonicalize().ok() == output;
        entry.depth() == 0 || (!entry.file_type().is_dir() || !(hidden || is_output())) && stays(entry, &boundary)
    };
    let mut models = Vec::new();
    for entry in WalkDir::new(folder).follow_links(true).sort_by_file_name().into_iter().filter_entry(wanted) {
        match entry {
            Ok(entry) if entry.file_type().is_file() && is_gltf(entry.path()) => {
                let below = entry.path().strip_prefix(folder).unwrap_or(entry.path()).with_extension("");
                models.push(Input { path: entry.into_path(), below });
            }
            Ok(_) => {}
            Err(e) => console::warning(&format!("skipped while searching: {e}")),
        }
    }
    models
}

/// Tells whether an entry is no link, or one that stays inside. Warns of others that would be searched or baked.
fn stays(entry: &DirEntry, boundary: &Boundary) -> bool {
    let target = if entry.path_is_symlink() { entry.path().canonicalize().ok() } else { None };
    let Some(target) = target.filter(|target| !boundary.holds(target)) else { return true };
    if entry.file_type().is_dir() || is_gltf(entry.path()) {
        let (link, target) = (entry.path().display(), target.display());
        console::warning(&format!(
            "{link} is skipped: it is a link to {target}, outside of the folder and its project"
        ));
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn tree(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("tempdir");
        for file in files {
            let path = dir.path().join(file);
            fs::create_dir_all(path.parent().expect("below")).expect("folder");
            fs::write(path, b"").expect("file");
        }
        dir
    }

    fn below(dir: &Path, output: &str) -> Vec<String> {
        let found = find(&[dir.to_owned()], &dir.join(output), None).expect("found");
        found.iter().map(|i| i.below.to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn folders_are_searched_in_path_order() {
        let dir = tree(&["b.gltf", "a/z.GLB", "a/b.v2.glb", "c.txt", ".git/x.glb", "lods/b.glb"]);
        assert_eq!(below(dir.path(), "lods"), ["a/b.v2", "a/z", "b"]);
        assert_eq!(below(dir.path(), "elsewhere"), ["a/b.v2", "a/z", "b", "lods/b"]);
    }

    #[test]
    fn files_keep_their_stem_only() {
        let found = find(&["x/y/fox.glb".into()], Path::new("lods"), None).expect("found");
        assert_eq!(found, [Input { path: "x/y/fox.glb".into(), below: "fox".into() }]);
    }

    #[test]
    fn patterns_are_expanded_unless_a_file_has_that_name() {
        let dir = tree(&["b.glb", "a.glb", "c.txt", "[a].glb"]);
        let found = |pattern: &str| {
            let found = find(&[dir.path().join(pattern)], Path::new("lods"), None).expect("found");
            found.iter().map(|i| i.below.to_string_lossy().into_owned()).collect::<Vec<_>>()
        };
        assert_eq!(found("?.glb"), ["a", "b"]);
        assert_eq!(found("[a].glb"), ["[a]"]);
        let none = find(&[dir.path().join("x*")], Path::new("lods"), None).expect_err("nothing matches").to_string();
        assert!(none.ends_with("x*: no .glb or .gltf file and no folder matches"), "{none}");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_inside_of_the_folder_and_its_project_only() {
        use std::os::unix::fs::symlink;
        let dir = tree(&["game/config/simpliguard.ron", "game/shared/s.glb", "game/in/a.glb", "elsewhere/x.glb"]);
        let folder = dir.path().join("game/in");
        for (target, link) in [("a.glb", "b.glb"), ("../shared", "shared"), ("../../elsewhere", "out"), ("/", "all")] {
            symlink(target, folder.join(link)).expect("links");
        }
        symlink("../../elsewhere/x.glb", folder.join("x.glb")).expect("links");
        assert_eq!(below(&folder, "lods"), ["a", "b", "shared/s"]);
        fs::remove_file(dir.path().join("game/config/simpliguard.ron")).expect("removes");
        assert_eq!(below(&folder, "lods"), ["a", "b"]);
        let wider = find(std::slice::from_ref(&folder), Path::new("lods"), Some(dir.path())).expect("found");
        assert_eq!(wider.len(), 5);
    }

    #[test]
    fn a_list_keeps_the_paths_below_its_root() {
        let dir = tree(&["list.txt"]);
        fs::write(dir.path().join("list.txt"), "in/a.glb\r\n\nb b.gltf\n../c.glb\n").expect("writes");
        let found = listed(&dir.path().join("list.txt"), Path::new("assets")).expect("read");
        let shown: Vec<_> = found.iter().map(|i| (i.path.to_str(), i.below.to_str())).collect();
        let expected = [("assets/in/a.glb", "in/a"), ("assets/b b.gltf", "b b"), ("assets/../c.glb", "c")];
        assert_eq!(shown, expected.map(|(path, below)| (Some(path), Some(below))));
        assert!(listed(&dir.path().join("none"), Path::new("")).is_err());
    }

    #[test]
    fn a_folder_without_models_is_a_usage_error() {
        let dir = tree(&["a.txt"]);
        assert!(find(&[dir.path().to_owned()], Path::new("lods"), None).is_err());
    }
}
