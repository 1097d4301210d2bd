//! The command of a worker: one `simpliguard bake` with the list of a task.

use super::manifest::Manifest;

/// The places of a task as the scheduler spells them. Each stands in the command as it is.
pub(super) struct Places {
    pub(super) assets: String,
    pub(super) project: String,
    pub(super) cache_dir: String,
    pub(super) shared_cache: String,
    pub(super) settings: String,
    /// The list of the task's models.
    pub(super) list: String,
    /// The report of the task.
    pub(super) report: String,
    /// A folder for the output, which nobody needs: the results are in the cache.
    pub(super) output: String,
}

/// The arguments of the command. `quote` makes a literal text an argument.
pub(super) fn arguments(manifest: &Manifest, places: &Places, quote: impl Fn(&str) -> String) -> Vec<String> {
    let mut arguments = vec![quote("bake")];
    let mut flag = |name: &str, value: &str| arguments.extend([quote(name), value.to_owned()]);
    flag("--files-from", &places.list);
    flag("--root", &places.assets);
    flag("--output", &places.output);
    flag("--report", &places.report);
    for (is_given, name, value) in [
        (manifest.project.is_some(), "--project", &places.project),
        (manifest.cache_dir.is_some(), "--cache-dir", &places.cache_dir),
        (manifest.shared_cache.is_some(), "--shared-cache", &places.shared_cache),
        (manifest.has_settings, "--settings", &places.settings),
    ] {
        if is_given {
            flag(name, value);
        }
    }
    arguments.extend(manifest.flags.iter().map(|text| quote(text)));
    arguments
}
