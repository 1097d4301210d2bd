//! All files of a cache, and which belong to which.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rayon::prelude::*;
use serde::Serialize;
use walkdir::WalkDir;

use crate::Cache;
use crate::record::Record;

/// A file of a cache.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredFile {
    pub(crate) path: PathBuf,
    /// The hash it is named by; empty for temporary files.
    pub(crate) hex: String,
    /// In bytes.
    pub(crate) size: u64,
    /// When it was written or last used.
    pub(crate) modified: SystemTime,
}

impl StoredFile {
    pub(crate) fn is_older_than(&self, age: Duration) -> bool {
        self.modified.elapsed().is_ok_and(|elapsed| elapsed > age)
    }
}

/// The record of a result and the objects that it names.
pub(crate) struct StoredResult {
    pub(crate) file: StoredFile,
    /// Names of the objects' files; empty if the record cannot be used.
    pub(crate) objects: Vec<String>,
    /// Whether all of them were there.
    pub(crate) is_complete: bool,
}

/// What was in a cache when it was looked at; others may have changed it since.
#[derive(Default)]
pub(crate) struct Inventory {
    pub(crate) results: Vec<StoredResult>,
    pub(crate) objects: BTreeMap<String, StoredFile>,
    pub(crate) stages: Vec<StoredFile>,
    pub(crate) quarantine: Vec<StoredFile>,
    pub(crate) locks: Vec<StoredFile>,
    /// Temporary files, most of them of writers that have died.
    pub(crate) temporary: Vec<StoredFile>,
}

impl Inventory {
    pub(crate) fn of(cache: &Cache) -> Self {
        let mut temporary = Vec::new();
        let mut named = |folder| {
            let (named, unnamed): (Vec<_>, Vec<_>) =
                files(&cache.root().join(folder)).into_iter().partition(|file| !file.hex.is_empty());
            temporary.extend(unnamed);
            named
        };
        let objects: BTreeMap<_, _> = named("objects").into_iter().map(|file| (file.hex.clone(), file)).collect();
        let (results, stages, locks) = (named("results"), named("stages"), named("locks"));
        let results = results.into_par_iter().map(|file| stored_result(file, &objects)).collect();
        Self { results, objects, stages, locks, temporary, quarantine: files(&cache.root().join("quarantine")) }
    }

    /// How many results name each object.
    pub(crate) fn references(&self) -> BTreeMap<&str, usize> {
        let mut references = BTreeMap::new();
        for object in self.results.iter().flat_map(|result| &result.objects) {
            *references.entry(object.as_str()).or_default() += 1;
        }
        references
    }

    /// Of everything, in bytes.
    pub(crate) fn size(&self) -> u64 {
        let results = self.results.iter().map(|result| &result.file);
        let rest = [&self.stages, &self.quarantine, &self.temporary].into_iter().flatten();
        results.chain(self.objects.values()).chain(rest).map(|file| file.size).sum()
    }
}

fn stored_result(file: StoredFile, objects: &BTreeMap<String, StoredFile>) -> StoredResult {
    let record = fs::read(&file.path).ok().and_then(|json| Record::parse(&json, &file.hex).ok().flatten());
    let is_there = |object: &crate::record::ObjectRecord| {
        objects.get(object.hash.to_hex().as_str()).is_some_and(|there| there.size == object.size)
    };
    let is_complete = record.as_ref().is_some_and(|record| record.objects.iter().all(is_there));
    let objects = record.map_or_else(Vec::new, |record| record.objects);
    StoredResult { file, objects: objects.iter().map(|object| object.hash.to_string()).collect(), is_complete }
}

/// The files below a folder that can be read, by path.
fn files(folder: &Path) -> Vec<StoredFile> {
    let entries = WalkDir::new(folder).min_depth(1).sort_by_file_name().into_iter().filter_map(Result::ok);
    let stored = |entry: walkdir::DirEntry| {
        let data = entry.metadata().ok().filter(fs::Metadata::is_file)?;
        let path = entry.into_path();
        Some(StoredFile {
            hex: hex(&path).unwrap_or_default(),
            size: data.len(),
            modified: data.modified().ok()?,
            path,
        })
    };
    entries.filter_map(stored).collect()
}

/// The hash of `ab/cdef..`.
fn hex(path: &Path) -> Option<String> {
    let [first, rest] = [path.parent()?.file_name()?, path.file_name()?].map(|name| name.to_string_lossy());
    let hex = format!("{first}{rest}");
    blake3::Hash::from_hex(&hex).ok().map(|_| hex)
}

/// Files and their bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Amount {
    /// How many.
    pub files: u64,
    /// Their sizes together.
    pub bytes: u64,
}

impl<'a> FromIterator<&'a StoredFile> for Amount {
    fn from_iter<T: IntoIterator<Item = &'a StoredFile>>(files: T) -> Self {
        files.into_iter().fold(Self::default(), |sum, file| Self { files: sum.files + 1, bytes: sum.bytes + file.size })
    }
}

/// What is in a cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Usage {
    /// Records of results.
    pub results: Amount,
    /// Those of them whose objects are not all there; they count as misses.
    pub incomplete: Amount,
    /// What results are made of.
    pub objects: Amount,
    /// Those of them that no result names.
    pub unreferenced: Amount,
    /// What stages have left behind for later bakes.
    pub stages: Amount,
    /// What did not match its hash.
    pub quarantine: Amount,
    /// Everything, in bytes.
    pub bytes: u64,
}

impl Cache {
    /// Counts what is in the cache. Others may change it meanwhile. An unreadable folder counts as empty.
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
