//! Caches for the tests.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use simpliguard_cache::{Cache, Entry, Flight, Key, KeyBuilder};

pub(crate) fn key(name: &str) -> Key {
    KeyBuilder::new("test").params(&name).finish()
}

pub(crate) fn entry() -> Entry {
    let objects = vec![("a.glb".to_owned(), vec![7; 3000]), ("report.json".to_owned(), b"{}".to_vec())];
    Entry { objects }
}

/// A request that is never cancelled, and whose notices are ignored.
pub(crate) fn flight(key: &Key) -> Flight<'_> {
    Flight { key, is_cancelled: &|| false, notify: &|_| {}, check: |_| Ok(true) }
}

pub(crate) fn filled(dir: &Path) -> Cache {
    let cache = Cache::new(dir.join("cache"));
    cache.put(&key("k"), &entry()).expect("stores");
    cache
}

/// All files below a folder.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.map(|e| e.expect("lists").path());
    paths.flat_map(|p| if p.is_dir() { files(&p) } else { vec![p] }).collect()
}

/// Makes all files of a cache older.
pub(crate) fn age(cache: &Cache, by: Duration) {
    for path in files(cache.root()) {
        let file = File::options().append(true).open(path).expect("opens");
        let modified = file.metadata().and_then(|data| data.modified()).expect("has a time");
        file.set_modified(modified - by).expect("sets the time");
    }
}

/// The time of the last recorded use of a file.
pub(crate) fn modified(path: &Path) -> SystemTime {
    fs::metadata(path).and_then(|data| data.modified()).expect("has a time")
}
