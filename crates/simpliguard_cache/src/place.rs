//! Where the cache is, and how large it may become.

use std::ffi::OsString;
use std::fs;
use std::path::{Component, Path, PathBuf, absolute};

use simpliguard::settings::{CacheSettings, ProjectFile};

use crate::shared::Shared;
use crate::{Cache, DEFAULT_MAX_SIZE};

/// Environment variable that names the cache's folder.
pub const ENV_VAR: &str = "SIMPLIGUARD_CACHE_DIR";

/// A project's file names a folder that is not the project's own; for a warning. Projects come from anywhere, and none
/// is to decide what is written outside of it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}: cache.dir: \"{dir}\" is not used: {} lies outside of the project's folder; results are kept in the user's cache \
     folder: pass --cache-dir or set {ENV_VAR} to use that one",
    ProjectFile::PATH,
    folder.display()
)]
pub struct OutsideProject {
    /// As the file has it.
    pub dir: String,
    /// The folder that is meant.
    pub folder: PathBuf,
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
    /// The cache of a project whose folder is `base`. Its folder is that of `explicit`, else of [`ENV_VAR`], else of the
    /// project's settings, else `simpliguard` in the user's cache folder. A folder outside of `base` that the settings
    /// name is passed over, and `tell` is called. The shared tier is that of `explicit`, else of
    /// [`crate::SHARED_ENV_VAR`], else of the project. `None` if the platform does not say where users' caches are.
    pub fn of_project(
        explicit: Explicit<'_>,
        settings: &CacheSettings,
        base: &Path,
        tell: impl FnOnce(OutsideProject),
    ) -> Option<Self> {
        let configured = || match configured(settings.dir.as_deref()?, base) {
            Ok(folder) => Some(folder),
            Err(outside) => {
                tell(outside);
                None
            }
        };
        let user = || directories::BaseDirs::new().map(|dirs| dirs.cache_dir().join("simpliguard"));
        let cache = Self::new(choose(explicit.dir, std::env::var_os(ENV_VAR), configured, user)?);
        let cache = cache.with_max_size(settings.max_size.unwrap_or(DEFAULT_MAX_SIZE));
        Some(cache.with_shared(Shared::of_project(explicit.shared, settings, base)))
    }
}

fn choose(
    explicit: Option<&Path>,
    variable: Option<OsString>,
    configured: impl FnOnce() -> Option<PathBuf>,
    user: impl FnOnce() -> Option<PathBuf>,
) -> Option<PathBuf> {
    let variable = variable.filter(|v| !v.is_empty()).map(PathBuf::from);
    explicit.map(Path::to_owned).or(variable).or_else(configured).or_else(user)
}

/// The folder that the file of the project in `base` names, if it lies in `base`.
fn configured(dir: &str, base: &Path) -> Result<PathBuf, OutsideProject> {
    let folder = base.join(dir);
    let resolved = resolve(&folder);
    match (resolve(base), &resolved) {
        (Some(base), Some(resolved)) if resolved.starts_with(&base) => Ok(folder),
        _ => Err(OutsideProject { dir: dir.to_owned(), folder: resolved.unwrap_or(folder) }),
    }
}

/// An absolute path without `..` and symbolic links. The end of it need not exist. `None` if a link leads nowhere.
fn resolve(path: &Path) -> Option<PathBuf> {
    let mut resolved = PathBuf::new();
    for component in absolute(Path::new(".").join(path)).ok()?.components() {
        match component {
            Component::ParentDir => drop(resolved.pop()),
            component => resolved.push(component),
        }
        if fs::symlink_metadata(&resolved).is_ok_and(|data| data.is_symlink()) {
            resolved = resolved.canonicalize().ok()?;
        }
    }
    // Names have one spelling then, on every platform.
    let existing = resolved.ancestors().find(|folder| folder.exists())?;
    Some(existing.canonicalize().ok()?.join(resolved.strip_prefix(existing).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_wish_wins() {
        let user = || Some(PathBuf::from("user"));
        let a = Path::new("arg");
        let config = || Some(PathBuf::from("config"));
        let variable = |v: &str| Some(OsString::from(v));
        assert_eq!(choose(Some(a), variable("env"), config, user).as_deref(), Some(a));
        assert_eq!(choose(None, variable("env"), config, user), Some("env".into()));
        assert_eq!(choose(None, variable(""), config, user), Some("config".into()));
        assert_eq!(choose(None, None, || None, user), Some("user".into()));
        assert_eq!(choose(None, None, || None, || None), None);
    }

    #[test]
    fn a_project_names_folders_of_its_own_only() {
        let dir = tempfile::tempdir().expect("tempdir");
        let base = dir.path().join("project");
        fs::create_dir_all(base.join("sub")).expect("makes");
        for inside in [".", "cache", "new/../cache/", "sub/../cache", "../project/cache"] {
            assert_eq!(configured(inside, &base), Ok(base.join(inside)));
        }
        let absolute = base.join("cache").to_str().expect("UTF-8").to_owned();
        assert_eq!(configured(&absolute, &base), Ok(base.join("cache")));
        let elsewhere = dir.path().join("elsewhere").to_str().expect("UTF-8").to_owned();
        for outside in ["..", "../../.git", "../projectile", "sub/../../x", "new/../../x", &elsewhere] {
            let error = configured(outside, &base).expect_err(outside);
            assert_eq!(error.dir, outside);
            assert!(!error.folder.starts_with(base.canonicalize().expect("exists")), "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_of_a_project_lead_nowhere_else() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().expect("tempdir");
        let base = dir.path().join("project");
        for folder in ["project/sub", "outside/deep"] {
            fs::create_dir_all(dir.path().join(folder)).expect("makes");
        }
        symlink("sub", base.join("inner")).expect("links");
        symlink("../outside/deep", base.join("outer")).expect("links");
        symlink("../nowhere", base.join("dangling")).expect("links");
        assert!(configured("inner/cache", &base).is_ok());
        for outside in ["outer", "outer/cache", "outer/../cache", "dangling", "dangling/cache"] {
            assert!(configured(outside, &base).is_err(), "{outside}");
        }
        // The project itself may lie behind a link.
        symlink("project", dir.path().join("link")).expect("links");
        assert!(configured("cache", &dir.path().join("link")).is_ok());
    }

    #[test]
    fn the_warning_says_what_to_do() {
        let outside = OutsideProject { dir: "../x".into(), folder: "/home/x".into() };
        assert_eq!(
            outside.to_string(),
            "config/simpliguard.ron: cache.dir: \"../x\" is not used: /home/x lies outside of the project's folder; \
             results are kept in the user's cache folder: pass --cache-dir or set SIMPLIGUARD_CACHE_DIR to use that one"
        );
    }
}
