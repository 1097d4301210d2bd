//! The shared tier: results of other machines.
//!
//! What is not here is fetched from there, checked and stored here; what is made here is stored there. A tier that
//! fails is left alone for a while and never stops a bake.

use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use simpliguard::Key;
use simpliguard::settings::CacheSettings;

use crate::{Cache, Entry, Lookup, StorageError};

/// Environment variable that names the shared tier.
pub const SHARED_ENV_VAR: &str = "SIMPLIGUARD_SHARED_CACHE";

/// How long a tier is left alone that has failed.
const PAUSE: Duration = Duration::from_secs(60);

/// A place for results that other machines use, too.
pub(crate) trait Tier: Debug + Send + Sync {
    /// The result of a key, checked. `Err` says why it cannot be had.
    fn get(&self, key: &Key) -> Result<Option<Entry>, String>;
    /// Stores a result.
    fn put(&self, key: &Key, entry: &Entry) -> Result<(), String>;
}

/// A tier as a cache uses it.
#[derive(Debug)]
pub(crate) struct Shared {
    address: String,
    tier: Result<Box<dyn Tier>, String>,
    read_only: bool,
    failed: Mutex<Option<Instant>>,
}

impl Shared {
    /// The tier of `explicit` (the command line), else of [`SHARED_ENV_VAR`], else of the project whose folder is `base`.
    pub(crate) fn of_project(explicit: Option<&str>, settings: &CacheSettings, base: &Path) -> Option<Self> {
        let variable = std::env::var(SHARED_ENV_VAR).ok().filter(|address| !address.is_empty());
        let (address, base) = match (explicit.map(str::to_owned).or(variable), &settings.shared) {
            (Some(address), _) => (address, Path::new("")),
            (None, Some(address)) => (address.clone(), base),
            (None, None) => return None,
        };
        Some(Self::open(&address, base, settings.shared_read_only))
    }

    fn open(address: &str, base: &Path, read_only: bool) -> Self {
        let tier: Result<Box<dyn Tier>, String> = match folder(address, base) {
            Some(folder) => Ok(Box::new(Cache::unlimited(folder, read_only))),
            None => open_cloud(address),
        };
        Self { address: address.to_owned(), tier, read_only, failed: Mutex::default() }
    }

    pub(crate) fn get(&self, key: &Key) -> Result<Option<Entry>, StorageError> {
        Ok(self.ask("read from", |tier| tier.get(key))?.flatten())
    }

    pub(crate) fn put(&self, key: &Key, entry: &Entry) -> Result<(), StorageError> {
        if self.read_only {
            return Ok(());
        }
        self.ask("write to", |tier| tier.put(key, entry)).map(drop)
    }

    /// `None` while the tier is left alone.
    fn ask<T>(
        &self,
        action: &'static str,
        what: impl FnOnce(&dyn Tier) -> Result<T, String>,
    ) -> Result<Option<T>, StorageError> {
        let failed = || self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        if failed().is_some_and(|at| at.elapsed() < PAUSE) {
            return Ok(None);
        }
        let answer = self.tier.as_ref().map_err(String::clone).and_then(|tier| what(tier.as_ref()));
        answer.map(Some).map_err(|reason| {
            *failed() = Some(Instant::now());
            StorageError::Shared { action, address: self.address.clone(), reason }
        })
    }
}

/// The folder of an address that is a path or a `file:` URL.
fn folder(address: &str, base: &Path) -> Option<PathBuf> {
    match address.split_once("://") {
        Some(("file", path)) => Some(path.into()),
        Some(_) => None,
        None => Some(base.join(address)),
    }
}

#[cfg(feature = "cloud")]
fn open_cloud(address: &str) -> Result<Box<dyn Tier>, String> {
    Ok(Box::new(crate::cloud::Cloud::open(address)?))
}

#[cfg(not(feature = "cloud"))]
fn open_cloud(_: &str) -> Result<Box<dyn Tier>, String> {
    Err("this build knows folders only; build it with the feature `cloud`".into())
}

/// A folder on a file server, with the layout of any cache.
impl Tier for Cache {
    fn get(&self, key: &Key) -> Result<Option<Entry>, String> {
        // A server that is not there is no empty cache.
        if !self.root().is_dir() {
            return Err("there is no such folder".into());
        }
        match Self::get(self, key) {
            Lookup::Hit(entry) => Ok(Some(entry)),
            Lookup::Miss => Ok(None),
            Lookup::Damaged(error) => Err(error.to_string()),
        }
    }

    fn put(&self, key: &Key, entry: &Entry) -> Result<(), String> {
        Self::put(self, key, entry).map_err(|e| e.to_string())
    }
}
