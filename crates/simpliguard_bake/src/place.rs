//! The place of the cache, and its size limit.

use std::ffi::OsString;
use std::fs;
use std::path::{Component, Path, PathBuf, absolute};

use simpliguard::Printable;
use simpliguard::settings::{CacheSettings, ProjectFile};
use simpliguard_cache::{Cache, DEFAULT_MAX_SIZE, PublicKey, SecretKey, Trust, read_bounded};

/// Environment variable with the folder of the cache.
pub const ENV_VAR: &str = "SIMPLIGUARD_CACHE_DIR";
/// Environment variable with the folder or address of the shared tier.
pub const SHARED_ENV_VAR: &str = "SIMPLIGUARD_SHARED_CACHE";

/// Environment variable with the public keys that must have signed the records of the shared tier, with commas between.
pub const TRUSTED_KEYS_ENV_VAR: &str = "SIMPLIGUARD_TRUSTED_KEYS";
/// Environment variable with the path of the file of the secret key that signs what this machine stores in the shared tier.
pub const SIGNING_KEY_ENV_VAR: &str = "SIMPLIGUARD_SIGNING_KEY";

/// Largest size in bytes of the file of a secret key.
const MOST_KEY_BYTES: u64 = 4096;

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
/// the project's settings. Its records are signed and trusted by the keys of [`SIGNING_KEY_ENV_VAR`] and
/// [`TRUSTED_KEYS_ENV_VAR`]; if these cannot be read, the tier is not used.
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
        Some((address, base)) => cache.with_signed_tier(&address, base, settings.shared_read_only, trust()),
        None => cache,
    })
}

/// The keys in the environment. A project's file has none: whom a machine trusts is for its owner to say.
fn trust() -> Result<Trust, String> {
    let given = |name| std::env::var_os(name).filter(|value| !value.is_empty());
    let trusted = given(TRUSTED_KEYS_ENV_VAR).map_or(Ok(Vec::new()), |keys| trusted_keys(&keys.to_string_lossy()))?;
    let signer = given(SIGNING_KEY_ENV_VAR).map(|path| signing_key(Path::new(&path))).transpose()?;
    Ok(Trust { trusted, signer })
}

fn trusted_keys(keys: &str) -> Result<Vec<PublicKey>, String> {
    let parse =
        |key: &str| PublicKey::parse(key).map_err(|e| format!("{TRUSTED_KEYS_ENV_VAR}: \"{}\": {e}", Printable(key)));
    keys.split(',').map(str::trim).map(parse).collect()
}

fn signing_key(path: &Path) -> Result<SecretKey, String> {
    let failed = |found: String| format!("{SIGNING_KEY_ENV_VAR}: {}: {found}", path.display());
    let bytes = read_bounded(path, MOST_KEY_BYTES).map_err(|e| failed(format!("cannot read the file: {e}")))?;
    SecretKey::parse(&String::from_utf8_lossy(&bytes)).map_err(failed)
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
    fn keys_that_cannot_be_read_are_no_keys() {
        let dir = tempfile::tempdir().expect("tempdir");
        let secret = SecretKey::from_bytes(&[1; 32]);
        let path = dir.path().join("key");
        fs::write(&path, secret.to_hex() + "\n").expect("writes");
        let public = signing_key(&path).expect("a key").public();
        assert_eq!(trusted_keys(&format!("{public}, {public}")), Ok(vec![public.clone(), public]));
        for wrong in ["x", ",", " "] {
            assert!(trusted_keys(wrong).is_err_and(|e| e.starts_with("SIMPLIGUARD_TRUSTED_KEYS: ")));
        }
        fs::write(&path, "short").expect("writes");
        assert!(signing_key(&path).is_err_and(|e| e.contains("64 hexadecimal digits") && !e.contains("short")));
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
