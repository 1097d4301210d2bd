//! Inputs: the models that the paths on the command line stand for.

use std::path::{Path, PathBuf};

use walkdir::{DirEntry, WalkDir};

use crate::console;
use crate::error::UsageError;
use crate::source::is_gltf;

/// A model, and the place of its result.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Input {
    /// The path as given, or below a folder as given.
    pub(crate) path: PathBuf,
    /// Path of the result, below the output folder, without extension.
    pub(crate) below: PathBuf,
}

/// The models of a command line: files as given, and all models below each folder in the order of their paths. Files
/// need not exist.
pub(crate) fn find(inputs: &[PathBuf], output: &Path) -> Result<Vec<Input>, UsageError> {
    let mut found = Vec::new();
    for input in inputs {
        if input.is_dir() {
            let models = search(input, output);
            if models.is_empty() {
                return Err(UsageError(format!(
                    "{}: there is no .glb or .gltf file below this folder",
                    input.display()
                )));
            }
            found.extend(models);
        } else {
            let below = input.file_name().map(PathBuf::from).unwrap_or_default().with_extension("");
            found.push(Input { path: input.clone(), below });
        }
    }
    Ok(found)
}

/// All models below a folder, in the order of their paths.
fn search(folder: &Path, output: &Path) -> Vec<Input> {
    let output = output.canonicalize().ok();
    let wanted = |entry: &DirEntry| {
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        let is_output = || output.is_some() && entry.path().canonicalize().ok() == output;
        entry.depth() == 0 || !entry.file_type().is_dir() || !(hidden || is_output())
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
        let found = find(&[dir.to_owned()], &dir.join(output)).expect("found");
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
        let found = find(&["x/y/fox.glb".into()], Path::new("lods")).expect("found");
        assert_eq!(found, [Input { path: "x/y/fox.glb".into(), below: "fox".into() }]);
    }

    #[test]
    fn a_folder_without_models_is_a_usage_error() {
        let dir = tree(&["a.txt"]);
        assert!(find(&[dir.path().to_owned()], Path::new("lods")).is_err());
    }
}
