//! The cache on disk.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, SystemTime};

use simpliguard_key::{Key, content_hash};

use crate::counters::{Tally, add};
use crate::error::StorageError;
use crate::file::{Durability, folder_of, replace};
use crate::folder::{OwnFolder, QUARANTINE};
use crate::read::read_bounded;
use crate::record::{Entry, MOST_RECORD_BYTES, ObjectRecord, Record};
use crate::retry::Backoff;
use crate::shared::Shared;
use crate::uploads::Uploads;

/// The size limit of a cache by default, in bytes.
pub const DEFAULT_MAX_SIZE: u64 = 10 << 30;

/// A use is recorded if the last recorded use is older.
pub(crate) const USE_NOTED_AFTER: Duration = Duration::from_secs(3600);

/// The outcome of [`Cache::get`].
#[derive(Debug)]
pub enum Lookup {
    /// The result: all its objects are there and match their hashes.
    Hit(Entry),
    /// No result.
    Miss,
    /// A result that cannot be used. The error is for a warning. It counts as a miss.
    Damaged(StorageError),
}

/// Counts since a [`Cache`] was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Results that were found.
    pub hits: u64,
    /// Results that were not found, or were damaged.
    pub misses: u64,
    /// Files that did not match their hash.
    pub quarantined: u64,
}

/// A cache. Any number of threads and processes may use it at the same time.
#[derive(Debug)]
pub struct Cache {
    root: PathBuf,
    folder: OwnFolder,
    max_size: u64,
    shared: Option<Arc<Shared>>,
    uploads: Option<Uploads>,
    tally: Tally,
    /// No file is moved, and no use is recorded.
    read_only: bool,
    hits: AtomicU64,
    misses: AtomicU64,
    quarantined: AtomicU64,
}

impl Cache {
    /// A cache in a folder, with a limit of [`DEFAULT_MAX_SIZE`]. The folder need not exist. Touches nothing.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        let root = root.into();
        Self {
            folder: OwnFolder::new(&root),
            root,
            max_size: DEFAULT_MAX_SIZE,
            shared: None,
            uploads: None,
            tally: Tally::default(),
            read_only: false,
            hits: 0.into(),
            misses: 0.into(),
            quarantined: 0.into(),
        }
    }

    /// A cache without a limit: somebody else limits its size.
    pub(crate) fn unlimited(root: impl Into<PathBuf>, read_only: bool) -> Self {
        Self { max_size: u64::MAX, read_only, ..Self::new(root) }
    }

    /// Sets the size limit in bytes. Above it, the least recently used files are removed.
    #[must_use]
    pub fn with_max_size(self, max_size: u64) -> Self {
        Self { max_size, ..self }
    }

    /// Tells whether the files of the cache stay as they are.
    pub(crate) fn is_read_only(&self) -> bool {
        self.read_only
    }

    pub(crate) fn with_shared(self, shared: Shared) -> Self {
        Self { shared: Some(Arc::new(shared)), ..self }
    }

    pub(crate) fn shared(&self) -> Option<&Arc<Shared>> {
        self.shared.as_ref()
    }

    /// Stores results in the shared tier in the background. The program calls [`Cache::finish`] before it ends; what is made
    /// after that is stored at once.
    #[must_use]
    pub fn with_background_uploads(self) -> Self {
        let uploads = self.shared.clone().and_then(Uploads::start);
        Self { uploads, ..self }
    }

    /// The uploads in the background, if there are any.
    pub(crate) fn uploads(&self) -> Option<&Uploads> {
        self.uploads.as_ref()
    }

    /// The counts of the folder as a tier.
    pub(crate) fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The size limit in bytes.
    pub fn max_size(&self) -> u64 {
        self.max_size
    }

    /// The folder that was given to [`Self::new`]. It may contain other files too.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder in [`Self::root`] that contains all files of the cache.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn own(&self) -> &OwnFolder {
        &self.folder
    }

    /// Checks that [`Self::folder`] is missing or belongs to the cache.
    ///
    /// # Errors
    /// [`StorageError::Foreign`] if it belongs to somebody else; [`StorageError::Io`] if it cannot be read.
    pub fn check(&self) -> Result<(), StorageError> {
        self.folder.check()
    }

    /// The counts since [`Self::new`].
    pub fn stats(&self) -> Stats {
        Stats {
            hits: self.hits.load(Relaxed),
            misses: self.misses.load(Relaxed),
            quarantined: self.quarantined.load(Relaxed),
        }
    }

    /// Looks up a result. Reads and checks all its objects.
    pub fn get(&self, key: &Key) -> Lookup {
        self.get_objects(key, |_| true)
    }

    /// Looks up a result. Reads and checks only the objects whose names are `wanted`. The other objects must be there
    /// with their full sizes.
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

    /// Stores a result: first its objects, then the record that lists them.
    ///
    /// # Errors
    /// The first file that cannot be written. The result is then a miss.
    pub fn put(&self, key: &Key, entry: &Entry) -> Result<(), StorageError> {
        let mut objects = Vec::with_capacity(entry.objects.len());
        let mut grown = 0;
        for (name, bytes) in &entry.objects {
            let hash = content_hash(bytes);
            if self.write_object(&hash, bytes)? {
                grown += bytes.len() as u64;
            }
            objects.push(ObjectRecord { name: name.clone(), hash, size: bytes.len() as u64 });
        }
        let path = self.path("results", key.as_bytes());
        let json = Record::new(key, objects).to_json();
        let json = json.map_err(|e| StorageError::Io { action: "write", path: path.clone(), source: e.into() })?;
        self.write(&path, &json, Durability::PowerLoss)?;
        self.has_grown(grown + json.len() as u64);
        add(&self.tally.stored, 1);
        Ok(())
    }

    /// Stores an object, unless it is there. Returns whether it was written.
    pub(crate) fn write_object(&self, hash: &blake3::Hash, bytes: &[u8]) -> Result<bool, StorageError> {
        let path = self.path("objects", hash.as_bytes());
        let there = self.read_file(&path, bytes.len() as u64);
        let is_there = there.is_ok_and(|there| there.as_deref() == Some(bytes));
        if is_there {
            // A collection that runs at the same time keeps objects that were just used.
            self.note_use(&path, Duration::ZERO);
        } else {
            self.write(&path, bytes, Durability::PowerLoss)?;
        }
        Ok(!is_there)
    }

    pub(crate) fn read(&self, key: &Key, wanted: impl Fn(&str) -> bool) -> Result<Option<Entry>, StorageError> {
        let path = self.path("results", key.as_bytes());
        let Some(json) = self.read_file(&path, MOST_RECORD_BYTES)? else { return Ok(None) };
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
        Ok(Some(Entry { objects }))
    }

    fn read_object(&self, hash: &blake3::Hash, size: u64) -> Result<Option<Vec<u8>>, StorageError> {
        let path = self.path("objects", hash.as_bytes());
        let bytes = match self.read_file(&path, size) {
            Ok(Some(bytes)) if bytes.len() as u64 == size => bytes,
            Ok(None) => return Ok(None),
            Err(StorageError::Io { source, .. }) if source.kind() != io::ErrorKind::FileTooLarge => {
                return Err(StorageError::Io { action: "read", path, source });
            }
            Ok(Some(_)) | Err(_) => {
                let found = fs::symlink_metadata(&path).map_or(0, |data| data.len());
                return Err(self.quarantine(path, &format!("has {found} bytes instead of {size}")));
            }
        };
        if content_hash(&bytes) != *hash {
            return Err(self.quarantine(path, "does not match its hash"));
        }
        Ok(Some(bytes))
    }

    /// Moves a damaged file to quarantine, and returns the error that describes the damage.
    pub(crate) fn quarantine(&self, path: PathBuf, reason: &str) -> StorageError {
        let nth = self.quarantined.fetch_add(1, Relaxed);
        add(&self.tally.damaged, 1);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let target = self.folder().join(QUARANTINE).join(format!("{name}.{}.{nth}", std::process::id()));
        let moved = !self.read_only
            && self.owns(&path).unwrap_or(false)
            && self
                .folder
                .write(&target, |target| Backoff::for_replacing().retry(|| fs::rename(&path, target)))
                .is_ok();
        StorageError::Damaged { path, reason: reason.to_owned(), moved }
    }

    /// The path of a file that is named by a hash, in one of the folders of the cache.
    pub(crate) fn path(&self, folder: &str, hash: &[u8; 32]) -> PathBuf {
        let hex = blake3::Hash::from_bytes(*hash).to_hex();
        let (first, rest) = hex.split_at(2);
        self.folder().join(folder).join(first).join(rest)
    }

    /// The content of a file of the cache with at most `most` bytes. `None` if there is no such file, or if the folder
    /// belongs to somebody else.
    pub(crate) fn read_file(&self, path: &Path, most: u64) -> Result<Option<Vec<u8>>, StorageError> {
        let is_there = self.owns(path);
        match is_there.and_then(|is_there| is_there.then(|| read_bounded(path, most)).transpose()) {
            Ok(bytes) => Ok(bytes),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(StorageError::Io { action: "read", path: path.to_owned(), source }),
        }
    }

    pub(crate) fn write(&self, path: &Path, bytes: &[u8], durability: Durability) -> Result<(), StorageError> {
        self.folder.write(path, |path| replace(folder_of(path), path, bytes, durability))
    }

    /// Records a use: sets the file's time to now if it is older than `after`. A file that cannot be written keeps its
    /// time.
    pub(crate) fn note_use(&self, path: &Path, after: Duration) {
        let modified = fs::symlink_metadata(path).and_then(|data| data.modified());
        let recent = |time: SystemTime| time.elapsed().is_ok_and(|age| age < after);
        if !modified.is_ok_and(recent) && self.owns(path).unwrap_or(false) {
            let _ = File::options().append(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
        }
    }

    /// Tells whether a path is a file of the cache with this size.
    pub(crate) fn has(&self, path: &Path, size: u64) -> bool {
        self.owns(path).unwrap_or(false) && fs::symlink_metadata(path).is_ok_and(|there| there.len() == size)
    }

    /// Tells whether a path is a file of the cache.
    pub(crate) fn owns(&self, path: &Path) -> io::Result<bool> {
        Ok(self.folder.is_ours()? && self.folder.has_file(path)?)
    }
}
