//! Where the cache is, and how large it may become.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use simpliguard::settings::CacheSettings;

use crate::shared::Shared;
use crate::{Cache, DEFAULT_MAX_SIZE};

/// Environment variable that names the cache's folder.
pub const ENV_VAR: &str = "SIMPLIGUARD_CACHE_DIR";

/// The cache's folder: `explicit` (the command line), then [`ENV_VAR`], then `configured` (the project), then
/// `simpliguard` in the user's cache folder. `None` if the platform does not say where that is.
pub fn place(explicit: Option<&Path>, configured: Option<&Path>) -> Option<PathBuf> {
    let user = || directories::BaseDirs::new().map(|dirs| dirs.cache_dir().join("simpliguard"));
    choose(explicit, std::env::var_os(ENV_VAR), configured, user)
}

/// What a command line, or the code of a game, says about the cache; it goes before everything else.
#[derive(Clone, Copy, Debug, Default)]
pub struct Explicit<'a> {
    /// Folder.
    pub dir: Option<&'a Path>,
    /// Folder or address of the shared tier.
    pub shared: Option<&'a str>,
}

impl Cache {
    /// The cache of a project whose folder is `base`. Its own folder is at the [`place`] that follows from `explicit` and the
    /// project's settings; its shared tier is that of `explicit`, else of [`crate::SHARED_ENV_VAR`], else of the project.
    /// `None` if the platform does not say where users' caches are.
    pub fn of_project(explicit: Explicit<'_>, settings: &CacheSettings, base: &Path) -> Option<Self> {
        let configured = settings.dir.as_ref().map(|dir| base.join(dir));
        let cache = Self::new(place(explicit.dir, configured.as_deref())?);
        let cache = cache.with_max_size(settings.max_size.unwrap_or(DEFAULT_MAX_SIZE));
        Some(cache.with_shared(Shared::of_project(explicit.shared, settings, base)))
    }
}

fn choose(
    explicit: Option<&Path>,
    variable: Option<OsString>,
    configured: Option<&Path>,
    user: impl FnOnce() -> Option<PathBuf>,
) -> Option<PathBuf> {
    let variable = variable.filter(|v| !v.is_empty()).map(PathBuf::from);
    explicit.map(Path::to_owned).or(variable).or_else(|| configured.map(Path::to_owned)).or_else(user)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_wish_wins() {
        let user = || Some(PathBuf::from("user"));
        let [a, c] = ["arg", "config"].map(Path::new);
        let variable = |v: &str| Some(OsString::from(v));
        assert_eq!(choose(Some(a), variable("env"), Some(c), user).as_deref(), Some(a));
        assert_eq!(choose(None, variable("env"), Some(c), user), Some("env".into()));
        assert_eq!(choose(None, variable(""), Some(c), user).as_deref(), Some(c));
        assert_eq!(choose(None, None, None, user), Some("user".into()));
        assert_eq!(choose(None, None, None, || None), None);
    }
}
