//! The shared tiers that there are: folders and, with the feature `cloud`, object storage.

use std::borrow::Cow;
use std::fs;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use blake3::Hash;
use percent_encoding::percent_decode_str;
use simpliguard_key::Key;

use crate::error::StorageError;
use crate::file::{Durability, can_write_in};
use crate::read::open_regular;
use crate::shared::Shared;
use crate::signature::Trust;
use crate::store::{Cache, USE_NOTED_AFTER};
use crate::tier::{Damaged, Fault, There, Tier};

impl Cache {
    /// Asks the shared tier whether it can be read and, unless it is read-only, written. Without a shared tier, nothing is
    /// asked. A tier that does not answer within a second is not waited for; [`Cache::finish`] tells what it says later.
    ///
    /// # Errors
    /// [`StorageError::Misconfigured`] if it can never be used; [`StorageError::ReadOnly`] if it is used for reading alone;
    /// others if it does not work at the moment.
    pub fn probe(&self) -> Result<(), StorageError> {
        self.shared().map_or(Ok(()), |shared| shared.probe())
    }

    /// Adds a shared tier. `address` is a folder, relative to `base`, or a URL such as `s3://bucket/folder`. With
    /// `read_only`, nothing is stored there. An address that cannot be used is reported at the first use of the tier.
    #[must_use]
    pub fn with_shared_tier(self, address: &str, base: &Path, read_only: bool) -> Self {
        self.with_signed_tier(address, base, read_only, Ok(Trust::default()))
    }

    /// Like [`Self::with_shared_tier`], with the keys that sign and vouch for its records. If `trust` is the reason why the keys
    /// cannot be used, the tier is not used either.
    #[must_use]
    pub fn with_signed_tier(self, address: &str, base: &Path, read_only: bool, trust: Result<Trust, String>) -> Self {
        let open = || -> Result<Arc<dyn Tier>, String> {
            match folder(address, base, cfg!(windows)) {
                Some(folder) => Ok(Arc::new(Self::unlimited(folder, read_only))),
                None => open_cloud(address),
            }
        };
        let (tier, trust) = match trust {
            Ok(trust) => (open(), trust),
            Err(reason) => (Err(reason), Trust::default()),
        };
        self.with_shared(Shared::new(address, tier, read_only, trust))
    }
}

/// The folder of an address that is a path or a `file:` URL.
fn folder(address: &str, base: &Path, windows: bool) -> Option<PathBuf> {
    match address.split_once("://") {
        Some((scheme, path)) if scheme.eq_ignore_ascii_case("file") => Some(file_url_path(path, windows)),
        // One letter is a drive.
        Some((scheme, _)) if scheme.len() > 1 => None,
        _ => Some(base.join(address)),
    }
}

/// The path of a `file:` URL, given by what follows `file://`: `/srv/cache`, `localhost/srv/cache` or, on Windows,
/// `/C:/cache` and `server/share`.
fn file_url_path(rest: &str, windows: bool) -> PathBuf {
    let rest = rest.strip_prefix("localhost").filter(|path| path.starts_with('/')).unwrap_or(rest);
    let path: Cow<'_, str> = percent_decode_str(rest).decode_utf8().unwrap_or(rest.into());
    let drive = |path: &str| matches!(path.as_bytes(), [b'/', letter, b':', ..] if letter.is_ascii_alphabetic());
    match &*path {
        path if windows && drive(path) => path[1..].into(),
        path if windows && !path.starts_with('/') => format!("//{path}").into(),
        path => path.into(),
    }
}

#[cfg(feature = "cloud")]
fn open_cloud(address: &str) -> Result<Arc<dyn Tier>, String> {
    Ok(Arc::new(crate::cloud::Cloud::open(address)?))
}

#[cfg(not(feature = "cloud"))]
fn open_cloud(_: &str) -> Result<Arc<dyn Tier>, String> {
    Err("this build knows folders only; build it with the feature `cloud`".into())
}

/// A folder on a file server, with the layout of any cache. What is in the way is compared with what is stored, so it needs no
/// telling apart.
impl Tier for Cache {
    fn probe(&self, write: bool) -> Result<(), Fault> {
        self.check_mounted()?;
        let failed = |source| StorageError::Io { action: "write", path: self.root().to_owned(), source };
        if write { can_write_in(self.root()).map_err(|e| failed(e).into()) } else { Ok(()) }
    }

    fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, Fault> {
        self.check_mounted()?;
        let path = self.path("results", key.as_bytes());
        let json = self.read_file(&path, most)?;
        if json.is_some() && !self.is_read_only() {
            self.note_use(&path, USE_NOTED_AFTER);
        }
        Ok(json)
    }

    fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, Fault> {
        let path = self.path("objects", object.as_bytes());
        let part = || {
            let mut file = open_regular(&path)?;
            file.seek(SeekFrom::Start(bytes.start))?;
            let mut part = Vec::new();
            file.take(bytes.end - bytes.start).read_to_end(&mut part).map(|_| part)
        };
        match self.owns(&path).and_then(|is_there| is_there.then(part).transpose()) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => {
                Err(StorageError::Io { action: "read", path, source }.into())
            }
            part => Ok(part.unwrap_or(None)),
        }
    }

    fn has_object(&self, object: &Hash, size: u64) -> Result<bool, Fault> {
        Ok(self.has(&self.path("objects", object.as_bytes()), size))
    }

    fn put_object(&self, object: &Hash, bytes: &[u8], _: There) -> Result<(), Fault> {
        self.check_mounted()?;
        Ok(self.write_object(object, bytes).map(drop)?)
    }

    fn put_record(&self, key: &Key, json: &[u8], there: There) -> Result<(), Fault> {
        self.check_mounted()?;
        let path = self.path("results", key.as_bytes());
        if there == There::Equal && self.read_file(&path, json.len() as u64).is_ok_and(|j| j.as_deref() == Some(json)) {
            return Ok(());
        }
        Ok(self.write(&path, json, Durability::PowerLoss)?)
    }

    fn set_aside(&self, damaged: Damaged, reason: &str) -> String {
        let path = match damaged {
            Damaged::Record(key) => self.path("results", key.as_bytes()),
            Damaged::Object(hash) => self.path("objects", hash.as_bytes()),
        };
        self.quarantine(path, reason).to_string()
    }
}

impl Cache {
    /// Checks that the folder itself is there. That of an unmounted server is missing, and must not look like an empty cache.
    fn check_mounted(&self) -> Result<(), Fault> {
        match fs::metadata(self.root()) {
            Ok(data) if data.is_dir() => Ok(()),
            Ok(_) => Err(Fault::NoPlace("it is no folder".into())),
            Err(_) => Err(Fault::Failed("there is no such folder".into())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_urls_are_folders() {
        let base = Path::new("project");
        let on =
            |windows, address: &str| folder(address, base, windows).map(|path| path.to_string_lossy().into_owned());
        for (address, unix, windows) in [
            ("file:///srv/cache", "/srv/cache", "/srv/cache"),
            ("file://localhost/srv/cache", "/srv/cache", "/srv/cache"),
            ("FILE:///my%20cache", "/my cache", "/my cache"),
            ("file:///C:/cache", "/C:/cache", "C:/cache"),
            ("file:///C%3A/my%20cache", "/C:/my cache", "C:/my cache"),
            ("file://server/share", "server/share", "//server/share"),
        ] {
            assert_eq!(on(false, address).as_deref(), Some(unix));
            assert_eq!(on(true, address).as_deref(), Some(windows));
        }
        assert_eq!(folder("server", base, true), Some(base.join("server")));
        assert!(folder("C://cache", base, true).is_some());
        assert_eq!(folder("s3://levels", base, true), None);
    }
}
