//! The store on disk.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, SystemTime};

use simpliguard::{Key, content_hash};

use crate::Durability;
use crate::file::{folder_of, replace};
use crate::folder::{OwnFolder, QUARANTINE};
use crate::record::{ObjectRecord, Record};
use crate::shared::Shared;

/// A use is noted if the last one is this long ago.
pub(crate) const USE_NOTED_AFTER: Duration = Duration::from_secs(3600);

/// The result of a bake: named objects, and who made them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// What computed it, such as `cpu`.
    pub made_by: String,
    /// Names and contents, in the order they were stored.
    pub objects: Vec<(String, Vec<u8>)>,
}

impl Entry {
    /// The content of an object.
    pub fn object(&self, name: &str) -> Option<&[u8]> {
        self.objects.iter().find(|(n, _)| n == name).map(|(_, bytes)| bytes.as_slice())
    }
}

/// What [`Cache::get`] found.
#[derive(Debug)]
pub enum Lookup {
    /// Everything is there and matches its hash.
    Hit(Entry),
    /// There is no such result.
    Miss,
    /// There is one, but it cannot be used; for a warning. It counts as a miss.
    Damaged(StorageError),
}

/// Something the store could not do. Never a reason to stop a bake.
#[derive(Debug, thiserror::Error)]
pub enum StorageError {
    /// The file system refused.
    #[error("cache: cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On what.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// There is something that this program has not made, where its own files are to be.
    #[error("cache: {} is not used: {found}; delete or rename it, or choose another folder for the cache", path.display())]
    Foreign {
        /// Where.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// A file does not hold what it should.
    #[error("cache: {} {reason}; {}", path.display(), if *moved { "moved to quarantine" } else { "it could not be moved away" })]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
        /// Whether it is in quarantine now.
        moved: bool,
    },
    /// The shared tier does not answer as it should.
    #[error(
        "shared cache: cannot {action} {address}: {reason}; results stay on this machine: check the address and your rights there"
    )]
    Shared {
        /// What was tried.
        action: &'static str,
        /// Where.
        address: String,
        /// Why not.
        reason: String,
    },
}

/// What a [`Cache`] has seen since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Results found whole.
    pub hits: u64,
    /// Results not found, or not whole.
    pub misses: u64,
    /// Files that did not match their hash.
    pub quarantined: u64,
}

/// A cache. Any number of threads and processes may use one at the same time.
#[derive(Debug)]
pub struct Cache {
    root: PathBuf,
    folder: OwnFolder,
    max_size: u64,
    shared: Option<Shared>,
    /// Files are neither moved nor touched.
    read_only: bool,
    hits: AtomicU64,
    misses: AtomicU64,
    quarantined: AtomicU64,
}

impl Cache {
    /// A cache in a folder, which need not exist yet, of at most [`crate::DEFAULT_MAX_SIZE`]. Touches nothing.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        let root = root.into();
        Self {
            folder: OwnFolder::new(&root),
            root,
            max_size: crate::DEFAULT_MAX_SIZE,
            shared: None,
            read_only: false,
            hits: 0.into(),
            misses: 0.into(),
            quarantined: 0.into(),
        }
    }

    /// A cache that somebody else keeps below a size.
    pub(crate) fn unlimited(root: impl Into<PathBuf>, read_only: bool) -> Self {
        Self { max_size: u64::MAX, read_only, ..Self::new(root) }
    }

    /// The same cache with another limit, in bytes: what was used longest ago goes when more is stored.
    #[must_use]
    pub fn with_max_size(self, max_size: u64) -> Self {
        Self { max_size, ..self }
    }

    pub(crate) fn with_shared(self, shared: Option<Shared>) -> Self {
        Self { shared, ..self }
    }

    pub(crate) fn shared(&self) -> Option<&Shared> {
        self.shared.as_ref()
    }

    /// Its limit in bytes.
    pub fn max_size(&self) -> u64 {
        self.max_size
    }

    /// The folder that it was given, which may hold other things too.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder in [`Self::root`] that all its files are in.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn own(&self) -> &OwnFolder {
        &self.folder
    }

    /// Whether [`Self::folder`] is missing or the cache's own.
    ///
    /// # Errors
    /// What is there instead, or why it cannot be told.
    pub fn check(&self) -> Result<(), StorageError> {
        self.folder.check()
    }

    /// Counts since [`Self::new`].
    pub fn stats(&self) -> Stats {
        Stats {
            hits: self.hits.load(Relaxed),
            misses: self.misses.load(Relaxed),
            quarantined: self.quarantined.load(Relaxed),
        }
    }

    /// Looks up a result, reading and checking all its objects.
    pub fn get(&self, key: &Key) -> Lookup {
        self.get_objects(key, |_| true)
    }

    /// Looks up a result, reading and checking only those of its objects whose names are `wanted`. The others must be
    /// there with their full size.
    pub fn get_objects(&self, key: &Key, wanted: impl Fn(&str) -> bool) -> Lookup {
        let (counter, lookup) = match self.read(key, wanted) {
            Ok(Some(entry)) => (&self.hits, Lookup::Hit(entry)),
            Ok(None) => (&self.misses, Lookup::Miss),
            Err(error) => (&self.misses, Lookup::Damaged(error)),
        };
        counter.fetch_add(1, Relaxed);
        if matches!(lookup, Lookup::Hit(_)) && !self.read_only {
            self.note_use(&self.path("results", key.as_bytes()), USE_NOTED_AFTER);
        }
        lookup
    }

    /// Stores a result: objects first, then the record that makes them count.
    pub fn put(&self, key: &Key, entry: &Entry) -> Result<(), StorageError> {
        let mut objects = Vec::with_capacity(entry.objects.len());
        let mut grown = 0;
        for (name, bytes) in &entry.objects {
            let hash = content_hash(bytes);
            let path = self.path("objects", hash.as_bytes());
            if self.read_file(&path).is_ok_and(|there| there.as_ref() == Some(bytes)) {
                // A collection that is under way leaves what was used just now.
                self.note_use(&path, Duration::ZERO);
            } else {
                self.write(&path, bytes, Durability::PowerLoss)?;
                grown += bytes.len() as u64;
            }
            objects.push(ObjectRecord { name: name.clone(), hash, size: bytes.len() as u64 });
        }
        let path = self.path("results", key.as_bytes());
        let json = Record::new(key, &entry.made_by, objects).to_json();
        let json = json.map_err(|e| StorageError::Io { action: "write", path: path.clone(), source: e.into() })?;
        self.write(&path, &json, Durability::PowerLoss)?;
        self.has_grown(grown + json.len() as u64);
        Ok(())
    }

    pub(crate) fn read(&self, key: &Key, wanted: impl Fn(&str) -> bool) -> Result<Option<Entry>, StorageError> {
        let path = self.path("results", key.as_bytes());
        let Some(json) = self.read_file(&path)? else { return Ok(None) };
        let record = match Record::parse(&json, &key.hex()) {
            Ok(Some(record)) => record,
            Ok(None) => return Ok(None),
            Err(reason) => return Err(self.quarantine(path, &reason)),
        };
        let mut objects = Vec::with_capacity(record.objects.len());
        for ObjectRecord { name, hash, size } in record.objects {
            if !wanted(&name) {
                if self.has(&self.path("objects", hash.as_bytes()), size) {
                    continue;
                }
                return Ok(None);
            }
            let Some(bytes) = self.read_object(&hash, size)? else { return Ok(None) };
            objects.push((name, bytes));
        }
        Ok(Some(Entry { made_by: record.made_by, objects }))
    }

    fn read_object(&self, hash: &blake3::Hash, size: u64) -> Result<Option<Vec<u8>>, StorageError> {
        let path = self.path("objects", hash.as_bytes());
        let Some(bytes) = self.read_file(&path)? else { return Ok(None) };
        if bytes.len() as u64 != size {
            return Err(self.quarantine(path, &format!("has {} bytes instead of {size}", bytes.len())));
        }
        if content_hash(&bytes) != *hash {
            return Err(self.quarantine(path, "does not match its hash"));
        }
        Ok(Some(bytes))
    }

    pub(crate) fn quarantine(&self, path: PathBuf, reason: &str) -> StorageError {
        let nth = self.quarantined.fetch_add(1, Relaxed);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let target = self.folder().join(QUARANTINE).join(format!("{name}.{}.{nth}", std::process::id()));
        let moved = !self.read_only
            && self.owns(&path).unwrap_or(false)
            && self.folder.write(&target, |target| fs::rename(&path, target)).is_ok();
        StorageError::Damaged { path, reason: reason.to_owned(), moved }
    }

    pub(crate) fn path(&self, folder: &str, hash: &[u8; 32]) -> PathBuf {
        let hex = blake3::Hash::from_bytes(*hash).to_hex();
        let (first, rest) = hex.split_at(2);
        self.folder().join(folder).join(first).join(rest)
    }

    /// The content of a file of the cache; `None` if there is none, or if its folder is not the cache's own.
    pub(crate) fn read_file(&self, path: &Path) -> Result<Option<Vec<u8>>, StorageError> {
        let is_there = self.owns(path);
        match is_there.and_then(|is_there| is_there.then(|| fs::read(path)).transpose()) {
            Ok(bytes) => Ok(bytes),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(StorageError::Io { action: "read", path: path.to_owned(), source }),
        }
    }

    pub(crate) fn write(&self, path: &Path, bytes: &[u8], durability: Durability) -> Result<(), StorageError> {
        self.folder.write(path, |path| replace(folder_of(path), path, bytes, durability))
    }

    /// Sets the time by which files are evicted, if it is older than `after`. A file that cannot be written keeps its
    /// own.
    pub(crate) fn note_use(&self, path: &Path, after: Duration) {
        let modified = fs::symlink_metadata(path).and_then(|data| data.modified());
        let recent = |time: SystemTime| time.elapsed().is_ok_and(|age| age < after);
        if !modified.is_ok_and(recent) && self.owns(path).unwrap_or(false) {
            let _ = File::options().append(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
        }
    }

    /// Whether there is a file of a size.
    fn has(&self, path: &Path, size: u64) -> bool {
        self.owns(path).unwrap_or(false) && fs::symlink_metadata(path).is_ok_and(|there| there.len() == size)
    }

    /// Whether a path names a file of the cache.
    pub(crate) fn owns(&self, path: &Path) -> io::Result<bool> {
        Ok(self.folder.is_ours()? && self.folder.has_file(path)?)
    }
}
