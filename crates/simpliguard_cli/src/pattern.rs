//! Patterns such as `models/*.glb` on the command line. The shells of Windows do not expand them.

use std::path::{Path, PathBuf};

use globset::GlobMatcher;
use simpliguard::data::compile_glob;
use walkdir::{DirEntry, WalkDir};

use crate::source::is_gltf;

/// Characters that make a path a pattern.
const WILD: &[char] = &['*', '?', '[', '{'];

/// A path with wildcards: `*` stays within a folder, `**` crosses folders.
pub(crate) struct Pattern {
    /// The folder in front of the first wildcard.
    base: PathBuf,
    matcher: GlobMatcher,
    /// Number of folders below the base, or as many as there are.
    depth: usize,
}

impl Pattern {
    /// The pattern that a path is. `None` for a path without wildcards. On Windows, a backslash separates folders.
    ///
    /// # Errors
    /// If the pattern is malformed.
    pub(crate) fn parse(path: &Path, windows: bool) -> Result<Option<Self>, String> {
        let Some(text) = path.to_str().filter(|text| text.contains(WILD)) else { return Ok(None) };
        let text = if windows { text.replace('\\', "/") } else { text.to_owned() };
        let wild = text.find(WILD).unwrap_or(0);
        let (base, rest) = text.split_at(text[..wild].rfind('/').map_or(0, |slash| slash + 1));
        let matcher = compile_glob(rest, |glob| {
            glob.literal_separator(true).backslash_escape(!windows).case_insensitive(windows);
        })?;
        let depth = if rest.contains("**") { usize::MAX } else { rest.split('/').count() };
        Ok(Some(Self { base: base.into(), matcher, depth }))
    }

    /// The models and folders that match, in the order of their paths. As in a shell, names that begin with a dot do not.
    pub(crate) fn find(&self) -> Vec<PathBuf> {
        let root = if self.base.as_os_str().is_empty() { Path::new(".") } else { &self.base };
        let walk = WalkDir::new(root).min_depth(1).max_depth(self.depth).sort_by_file_name().into_iter();
        let entries = walk.filter_entry(|entry| entry.depth() == 0 || !is_hidden(entry)).filter_map(Result::ok);
        let below = |entry: DirEntry| {
            let below = entry.path().strip_prefix(root).ok()?.to_owned();
            let is_input = is_gltf(&below) || entry.path().is_dir();
            (is_input && self.matcher.is_match(&below)).then(|| self.base.join(below))
        };
        let mut found: Vec<PathBuf> = entries.filter_map(below).collect();
        // A folder stands for everything in it.
        let folders: Vec<PathBuf> = found.iter().filter(|path| path.is_dir()).cloned().collect();
        found.retain(|path| !path.ancestors().skip(1).any(|above| folders.iter().any(|folder| folder == above)));
        found
    }
}

fn is_hidden(entry: &DirEntry) -> bool {
    entry.file_name().to_string_lossy().starts_with('.')
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn names(dir: &Path, pattern: &str, windows: bool) -> Vec<String> {
        let found = Pattern::parse(&dir.join(pattern), windows).expect("well-formed").expect("a pattern").find();
        found.iter().map(|path| path.strip_prefix(dir).expect("below").to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn patterns_are_expanded_as_in_a_shell() {
        let dir = tempfile::tempdir().expect("tempdir");
        for file in ["models/b.glb", "models/a.glb", "models/a.png", "models/.c.glb", "models/deep/d.GLTF", "e.glb"] {
            let path = dir.path().join(file);
            fs::create_dir_all(path.parent().expect("below")).expect("makes");
            fs::write(path, b"").expect("writes");
        }
        let both = ["models/a.glb", "models/b.glb"];
        assert_eq!(names(dir.path(), "models/*.glb", false), both);
        assert_eq!(names(dir.path(), "models\\*.glb", true), both);
        assert_eq!(names(dir.path(), "models/*.png", false), [""; 0]);
        assert_eq!(names(dir.path(), "models/[a].g?b", false), ["models/a.glb"]);
        assert_eq!(names(dir.path(), "models\\*\\*.gltf", true), ["models/deep/d.GLTF"]);
        assert_eq!(names(dir.path(), "**/*.glb", false), ["e.glb", "models/a.glb", "models/b.glb"]);
        assert_eq!(names(dir.path(), "mod*", false), ["models"]);
        assert_eq!(names(dir.path(), "models/*", false), ["models/a.glb", "models/b.glb", "models/deep"]);
    }

    #[test]
    fn paths_are_no_patterns() {
        assert!(Pattern::parse(Path::new("models/a.glb"), true).expect("well-formed").is_none());
        assert!(Pattern::parse(Path::new("models/[a"), true).is_err());
    }
}
