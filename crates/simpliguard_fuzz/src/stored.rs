//! What caches hold.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use simpliguard::KeyBuilder;
use simpliguard_bake::BakeResult;
use simpliguard_cache::{Cache, Entry, Lookup};
use tempfile::TempDir;

/// A cache with one result, and the file of its record.
struct OneResult {
    _folder: TempDir,
    cache: Cache,
    key: simpliguard::Key,
    record: PathBuf,
    content: Vec<u8>,
}

static CACHE: LazyLock<OneResult> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    let (cache, key) = (Cache::new(folder.path()), KeyBuilder::new("fuzz").finish());
    let entry = Entry { objects: vec![("report.json".to_owned(), b"{}".to_vec())] };
    cache.put(&key, &entry).expect("it is kept");
    let record = record_in(&cache.folder().join("results")).expect("it has a record");
    let content = std::fs::read(&record).expect("it can be read");
    OneResult { _folder: folder, cache, key, record, content }
});

/// The only file in the folder of records.
fn record_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.filter_map(Result::ok).map(|entry| entry.path());
    let found = |path: PathBuf| if path.is_dir() { record_in(&path) } else { Some(path) };
    entries.into_iter().find_map(found)
}

/// Reads the bytes as an object of a stage, as a part of a result, and as the record of one.
pub fn stored(bytes: &[u8]) {
    let _ = simpliguard::is_stage_object(bytes);
    for name in ["combined.glb", "report.json", "sheet.png"] {
        let entry = Entry { objects: vec![(name.to_owned(), bytes.to_vec())] };
        let _ = (BakeResult::check(&entry), BakeResult::from_entry(entry));
    }
    let OneResult { cache, key, record, content, .. } = &*CACHE;
    std::fs::create_dir_all(record.parent().expect("it lies in a folder")).expect("a folder");
    std::fs::write(record, bytes).expect("it is written");
    if let Lookup::Hit(entry) = cache.get(key) {
        assert!(bytes == content || entry.objects.iter().all(|(_, object)| object == b"{}"), "a forged hit");
    }
}
