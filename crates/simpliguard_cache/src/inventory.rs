//! The inventory: all files of a cache, and the objects of each result.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rayon::prelude::*;
use serde::Serialize;
use walkdir::{DirEntry, WalkDir};

use crate::file::is_temporary;
use crate::folder::{QUARANTINE, State, is_folder, is_hex};
use crate::read::read_bounded;
use crate::record::{MOST_RECORD_BYTES, ObjectRecord, Record};
use crate::store::Cache;

/// Largest difference between the clocks of machines that share a folder.
const CLOCK_DIFFERENCE: Duration = Duration::from_secs(3600);

/// A file of a cache.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredFile {
    pub(crate) path: PathBuf,
    /// The hash in its name. Empty for temporary files and for those in quarantine.
    pub(crate) hex: String,
    /// In bytes.
    pub(crate) size: u64,
    /// Time of the last recorded use, or of writing.
    pub(crate) modified: SystemTime,
}

impl StoredFile {
    /// Tells whether the last use is longer ago than `age`. A date in the future is wrong, so such a file counts as
    /// old.
    pub(crate) fn is_older_than(&self, age: Duration) -> bool {
        match self.modified.elapsed() {
            Ok(elapsed) => elapsed > age,
            Err(ahead) => ahead.duration() > CLOCK_DIFFERENCE,
        }
    }
}

/// The record of a result and the objects that it names.
pub(crate) struct StoredResult {
    pub(crate) file: StoredFile,
    /// Hashes of the objects as hexadecimal digits. Empty if the record cannot be used.
    pub(crate) objects: Vec<String>,
    /// True if all objects were there.
    pub(crate) is_complete: bool,
}

/// The files of a cache at one moment. Other processes may change the cache meanwhile.
#[derive(Default)]
pub(crate) struct Inventory {
    pub(crate) results: Vec<StoredResult>,
    pub(crate) objects: BTreeMap<String, StoredFile>,
    pub(crate) stages: Vec<StoredFile>,
    pub(crate) quarantine: Vec<StoredFile>,
    pub(crate) locks: Vec<StoredFile>,
    /// Temporary files, mostly of writers that were killed.
    pub(crate) temporary: Vec<StoredFile>,
}

impl Inventory {
    /// Lists the files whose names and places are those that this program uses. Lists nothing in a folder of somebody
    /// else.
    pub(crate) fn of(cache: &Cache) -> Self {
        if !matches!(cache.own().state(), Ok(State::Ours | State::Empty)) {
            return Self::default();
        }
        let mut temporary = files(cache.folder(), 1, temporary_name);
        let mut named = |folder| {
            let files = files(&cache.folder().join(folder), 2, |path| hash_name(path).or_else(|| temporary_name(path)));
            let (named, unnamed): (Vec<_>, Vec<_>) = files.into_iter().partition(|file| !file.hex.is_empty());
            temporary.extend(unnamed);
            named
        };
        let objects: BTreeMap<_, _> = named("objects").into_iter().map(|file| (file.hex.clone(), file)).collect();
        let (results, stages, locks) = (named("results"), named("stages"), named("locks"));
        let results = results.into_par_iter().map(|file| stored_result(file, &objects)).collect();
        let quarantine = files(&cache.folder().join(QUARANTINE), 1, quarantine_name);
        Self { results, objects, stages, locks, temporary, quarantine }
    }

    /// The paths of all files. Records come first, so that no record is left without its objects.
    pub(crate) fn into_paths(self) -> impl Iterator<Item = PathBuf> {
        let results = self.results.into_iter().map(|result| result.file);
        let rest = [self.stages, self.quarantine, self.locks, self.temporary].into_iter().flatten();
        results.chain(self.objects.into_values()).chain(rest).map(|file| file.path)
    }

    /// The number of results that contain each object.
    pub(crate) fn references(&self) -> BTreeMap<&str, usize> {
        let mut references = BTreeMap::new();
        for object in self.results.iter().flat_map(|result| &result.objects) {
            *references.entry(object.as_str()).or_default() += 1;
        }
        references
    }

    /// The size of all files in bytes.
    pub(crate) fn size(&self) -> u64 {
        let results = self.results.iter().map(|result| &result.file);
        let rest = [&self.stages, &self.quarantine, &self.temporary].into_iter().flatten();
        results.chain(self.objects.values()).chain(rest).map(|file| file.size).sum()
    }
}

fn stored_result(file: StoredFile, objects: &BTreeMap<String, StoredFile>) -> StoredResult {
    let record = read_bounded(&file.path, MOST_RECORD_BYTES)
        .ok()
        .and_then(|json| Record::parse(&json, &file.hex).ok().flatten());
    let is_there = |object: &ObjectRecord| {
        objects.get(object.hash.to_hex().as_str()).is_some_and(|there| there.size == object.size)
    };
    let is_complete = record.as_ref().is_some_and(|record| record.objects.iter().all(is_there));
    let objects = record.map_or_else(Vec::new, |record| record.objects);
    StoredResult { file, objects: objects.iter().map(|object| object.hash.to_string()).collect(), is_complete }
}

/// The files of the cache that lie `depth` levels below a folder, sorted by path. `hex` gives the hash in a file's
/// name, or `None` for a file that this program has not written.
fn files(folder: &Path, depth: usize, hex: impl Fn(&Path) -> Option<String>) -> Vec<StoredFile> {
    // `WalkDir` follows a link at its root.
    if !is_folder(folder) {
        return Vec::new();
    }
    let walk = WalkDir::new(folder).min_depth(1).max_depth(depth).sort_by_file_name().into_iter();
    let leads_to_ours = |entry: &DirEntry| entry.depth() == depth || is_hex(entry.file_name(), 2);
    let entries = walk.filter_entry(leads_to_ours).filter_map(Result::ok).filter(|entry| entry.depth() == depth);
    let stored = |entry: DirEntry| {
        let hex = hex(entry.path())?;
        let data = entry.metadata().ok().filter(fs::Metadata::is_file)?;
        Some(StoredFile { hex, size: data.len(), modified: data.modified().ok()?, path: entry.into_path() })
    };
    entries.filter_map(stored).collect()
}

/// The hash in a path `ab/cdef..`.
fn hash_name(path: &Path) -> Option<String> {
    let (first, rest) = (path.parent()?.file_name()?, path.file_name()?);
    (is_hex(first, 2) && is_hex(rest, 62)).then(|| format!("{}{}", first.to_string_lossy(), rest.to_string_lossy()))
}

/// An empty hash for the path of a temporary file.
fn temporary_name(path: &Path) -> Option<String> {
    is_temporary(path.file_name()?).then(String::new)
}

/// An empty hash for the path of a file in quarantine: the rest of its hash, the id of the process that moved it, and a
/// count.
fn quarantine_name(path: &Path) -> Option<String> {
    let mut parts = path.file_name()?.to_str()?.split('.');
    let is_hash = is_hex(parts.next()?.as_ref(), 62);
    let is_number = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    (is_hash && is_number(parts.next()?) && is_number(parts.next()?) && parts.next().is_none()).then(String::new)
}

/// A number of files and their total size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Amount {
    /// Number of files.
    pub files: u64,
    /// Total size in bytes.
    pub bytes: u64,
}

impl<'a> FromIterator<&'a StoredFile> for Amount {
    fn from_iter<T: IntoIterator<Item = &'a StoredFile>>(files: T) -> Self {
        files.into_iter().fold(Self::default(), |sum, file| Self { files: sum.files + 1, bytes: sum.bytes + file.size })
    }
}

/// The content of a cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Usage {
    /// Records of results.
    pub results: Amount,
    /// Records of results that have lost an object. They count as misses.
    pub incomplete: Amount,
    /// Objects of results.
    pub objects: Amount,
    /// Objects that belong to no result.
    pub unreferenced: Amount,
    /// Stage objects.
    pub stages: Amount,
    /// Files that did not match their hashes.
    pub quarantine: Amount,
    /// Total size in bytes.
    pub bytes: u64,
}

impl Cache {
    /// Counts the files of the cache. Other processes may change it meanwhile. An unreadable folder counts as empty.
    pub fn usage(&self) -> Usage {
        let inventory = Inventory::of(self);
        let references = inventory.references();
        let results = || inventory.results.iter();
        Usage {
            results: results().map(|result| &result.file).collect(),
            incomplete: results().filter(|result| !result.is_complete).map(|result| &result.file).collect(),
            objects: inventory.objects.values().collect(),
            unreferenced: inventory.objects.values().filter(|o| !references.contains_key(o.hex.as_str())).collect(),
            stages: inventory.stages.iter().collect(),
            quarantine: inventory.quarantine.iter().collect(),
            bytes: inventory.size(),
        }
    }
}
