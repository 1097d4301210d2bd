//! The shared tiers that there are: folders and, with the feature `cloud`, object storage.

use std::path::{Path, PathBuf};

use simpliguard_key::Key;

use crate::record::Entry;
use crate::shared::{Shared, Tier};
use crate::store::{Cache, Lookup};

impl Cache {
    /// Adds a shared tier. `address` is a folder, relative to `base`, or a URL such as `s3://bucket/folder`. With
    /// `read_only`, nothing is stored there. An address that cannot be used is reported at the first use of the tier.
    #[must_use]
    pub fn with_shared_tier(self, address: &str, base: &Path, read_only: bool) -> Self {
        let tier: Result<Box<dyn Tier>, String> = match folder(address, base) {
            Some(folder) => Ok(Box::new(Self::unlimited(folder, read_only))),
            None => open_cloud(address),
        };
        self.with_shared(Shared::new(address, tier, read_only))
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
        // The folder of an unmounted server is missing. It must not look like an empty cache.
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
