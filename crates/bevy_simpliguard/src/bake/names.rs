//! Names of models. Bevy finds the processor of a file by the part of its name behind the first dot, in this spelling.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::Path;

use walkdir::WalkDir;

/// The usual extensions of models, and unusual ones of models below `folder`, such as `v2.glb` and `GLB`.
pub(super) fn extensions(folder: &Path) -> BTreeSet<String> {
    let mut extensions = BTreeSet::from(["glb", "gltf"].map(str::to_owned));
    for entry in WalkDir::new(folder).follow_links(true).into_iter().filter_map(Result::ok) {
        extensions.extend(full_extension(entry.file_name()));
    }
    extensions
}

/// The part behind the first dot in the name of a model.
fn full_extension(name: &OsStr) -> Option<String> {
    let (_, extension) = name.to_str()?.split_once('.')?;
    is_model(Path::new(name)).then(|| extension.to_owned())
}

/// Tells whether a file is a model by its name.
pub(super) fn is_model(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_with_several_dots_or_capitals_are_found() {
        let dir = tempfile::tempdir().expect("tempdir");
        std::fs::create_dir(dir.path().join("a.b")).expect("makes");
        for name in ["hero.v2.glb", "a.b/HERO.GLTF", "hero.glb.meta", "glb", "x.png"] {
            std::fs::write(dir.path().join(name), "").expect("writes");
        }
        let found: Vec<String> = extensions(dir.path()).into_iter().collect();
        assert_eq!(found, ["GLTF", "glb", "gltf", "v2.glb"]);
        assert_eq!(extensions(Path::new("none")).len(), 2);
    }
}
