//! The place of the cache, and its size limit.

use std::ffi::OsString;
use std::fs;
use std::path::{Component, Path, PathBuf, absolute};

use simpliguard::Printable;
use simpliguard::settings::{CacheSettings, ProjectFile};
use simpliguard_cache::{Cache, DEFAULT_MAX_SIZE};

/// Environment variable with the folder of the cache.
pub const ENV_VAR: &str = "SIMPLIGUARD_CACHE_DIR";
/// Environment variable with the folder or address of the shared tier.
pub const SHARED_ENV_VAR: &str = "SIMPLIGUARD_SHARED_CACHE";

/// A project's file names a folder outside of the project, for a warning. Projects come from anywhere, and none may
/// decide where files are written outside of it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}: cache.dir: \"{}\" is not used: {} lies outside of the project's folder; results are kept in the user's cache \
     folder: pass --cache-dir or set {ENV_VAR} to use that one",
    ProjectFile::PATH,
    Printable(dir),
    Printable(&folder.to_string_lossy())
)]
pub struct OutsideProject {
    /// The folder as the file spells it.
    pub dir: String,
    /// The resolved folder.
    pub folder: PathBuf,
}

/// The place of a cache as a command line or the code of a game gives it. It has precedence over everything else.
#[derive(Clone, Copy, Debug, Default)]
pub struct CachePlace<'a> {
    /// Folder of the cache.
    pub dir: Option<&'a Path>,
    /// Folder or address of the shared tier.
    pub shared: Option<&'a str>,
}

/// The cache of the project in the folder `base`.
///
/// The folder of the cache is the first of: the one in `explicit`, [`ENV_VAR`], the project's settings, and
/// `simpliguard` in the user's cache folder. A folder in the settings that lies outside of `base` is not used, and
/// `notify` is called. The address of the shared tier is the first of: the one in `explicit`, [`SHARED_ENV_VAR`], and
/// the project's settings.
///
/// `None` if the platform has no cache folder for users.
pub fn open_cache(
    explicit: CachePlace<'_>,
    settings: &CacheSettings,
    base: &Path,
    notify: impl FnOnce(OutsideProject),
) -> Option<Cache> {
    let configured = || match configured(settings.dir.as_deref()?, base) {
        Ok(folder) => Some(folder),
        Err(outside) => {
            notify(outside);
            None
        }
    };
    let user = || directories::BaseDirs::new().map(|dirs| dirs.cache_dir().join("simpliguard"));
    let cache = Cache::new(choose(explicit.dir, std::env::var_os(ENV_VAR), configured, user)?);
    let cache = cache.with_max_size(settings.max_size.unwrap_or(DEFAULT_MAX_SIZE));
    let variable = std::env::var(SHARED_ENV_VAR).ok();
    Some(match shared_address(explicit.shared, variable, settings, base) {
        Some((address, base)) => cache.with_shared_tier(&address, base, settings.shared_read_only),
        None => cache,
    })
}

/// The address of the shared tier, and the folder that it is relative to.
fn shared_address<'a>(
    explicit: Option<&str>,
    variable: Option<String>,
    settings: &CacheSettings,
    base: &'a Path,
) -> Option<(String, &'a Path)> {
    let variable = variable.filter(|address| !address.is_empty());
    let given = explicit.map(str::to_owned).or(variable).map(|address| (address, Path::new("")));
    given.or_else(|| Some((settings.shared.clone()?, base)))
}

/// The first folder that is given.
fn choose(
    explicit: Option<&Path>,
    variable: Option<OsString>,
    configured: impl FnOnce() -> Option<PathBuf>,
    user: impl FnOnce() -> Option<PathBuf>,
) -> Option<PathBuf> {
    let variable = variable.filter(|v| !v.is_empty()).map(PathBuf::from);
    explicit.map(Path::to_owned).or(variable).or_else(configured).or_else(user)
}

/// The folder in the settings of the project in `base`, if it lies in `base`.
fn configured(dir: &str, base: &Path) -> Result<PathBuf, OutsideProject> {
    let folder = base.join(dir);
    if names_a_server(dir) {
        return Err(OutsideProject { dir: dir.to_owned(), folder });
    }
    let resolved = resolve(&folder);
    match (resolve(base), &resolved) {
        (Some(base), Some(resolved)) if resolved.starts_with(&base) => Ok(folder),
        _ => Err(OutsideProject { dir: dir.to_owned(), folder: resolved.unwrap_or(folder) }),
    }
}

/// Tells whether a path is that of a server or a device on Windows: `//server/share`, `\\?\C:`. Looking at such a path
/// would already send the user's name and a hash of the password to the server, so it is told by its text, on every system.
fn names_a_server(dir: &str) -> bool {
    dir.starts_with(|c| "/\\".contains(c)) && dir[1..].starts_with(|c| "/\\".contains(c))
}

/// The absolute path without `..` and symbolic links. The last parts need not exist. `None` if a link leads nowhere.
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
    // On every platform, canonical names have one spelling.
    let existing = resolved.ancestors().find(|folder| folder.exists())?;
    Some(existing.canonicalize().ok()?.join(resolved.strip_prefix(existing).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_folder_wins() {
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
    fn the_nearest_shared_tier_wins() {
        let settings = CacheSettings { shared: Some("server".into()), ..CacheSettings::default() };
        let base = Path::new("project");
        let address = |explicit, variable: &str, settings: &CacheSettings| {
            shared_address(explicit, Some(variable.to_owned()), settings, base)
                .map(|(address, base)| base.join(address))
        };
        assert_eq!(address(Some("arg"), "env", &settings), Some("arg".into()));
        assert_eq!(address(None, "env", &settings), Some("env".into()));
        assert_eq!(address(None, "", &settings), Some("project/server".into()));
        assert_eq!(address(None, "", &CacheSettings::default()), None);
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

    #[test]
    fn servers_are_no_folders_of_a_project() {
        for server in ["//server/share", "\\\\server\\share", "\\/server/share", "//?/C:/x", "\\\\.\\pipe\\x", "//"] {
            // The root of the file system would hold them all.
            assert!(configured(server, Path::new("/")).is_err(), "{server}");
        }
        for folder in ["cache", "a//b", "a\\\\b"] {
            assert!(!names_a_server(folder), "{folder}");
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
