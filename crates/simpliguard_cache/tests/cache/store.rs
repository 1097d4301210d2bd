//! Storing and finding, with files going wrong in every way they can.

use std::fs;
use std::path::PathBuf;

use simpliguard_cache::{Cache, Entry, Lookup, StorageError};

use crate::folder::{entry, files, filled, key};

fn large_object(cache: &Cache) -> PathBuf {
    let of_size = |p: &PathBuf| fs::metadata(p).expect("exists").len() == 3000;
    files(&cache.folder().join("objects")).into_iter().find(of_size).expect("the large object")
}

fn assert_damaged(cache: &Cache, reason: &str) {
    match cache.get(&key("k")) {
        Lookup::Damaged(StorageError::Damaged { reason: r, moved: true, .. }) => assert!(r.contains(reason), "{r}"),
        other => panic!("{other:?}"),
    }
    assert_eq!(cache.stats().quarantined, 1);
    assert_eq!(files(&cache.folder().join("quarantine")).len(), 1);
    // Gone from its place, so the next one is a plain miss, and storing again heals it.
    assert!(matches!(cache.get(&key("k")), Lookup::Miss));
    cache.put(&key("k"), &entry()).expect("stores again");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(_)));
}

#[test]
fn what_was_stored_is_found() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    match cache.get(&key("k")) {
        Lookup::Hit(found) => assert_eq!(found, entry()),
        other => panic!("{other:?}"),
    }
    assert!(matches!(cache.get(&key("other")), Lookup::Miss));
    assert_eq!((cache.stats().hits, cache.stats().misses), (1, 1));
}

#[test]
fn an_empty_folder_is_a_miss_and_stays_empty() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path().join("none"));
    assert!(matches!(cache.get(&key("k")), Lookup::Miss));
    assert!(!cache.root().exists());
}

#[test]
fn equal_objects_are_stored_once() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put(&key("other"), &entry()).expect("stores");
    assert_eq!(files(&cache.folder().join("objects")).len(), 2);
    assert_eq!(files(&cache.folder().join("results")).len(), 2);
}

#[test]
fn a_flipped_bit_is_quarantined() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let path = large_object(&cache);
    let mut bytes = fs::read(&path).expect("reads");
    bytes[1234] ^= 1;
    fs::write(&path, bytes).expect("writes");
    assert_damaged(&cache, "does not match its hash");
}

#[test]
fn a_truncated_object_is_quarantined() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    fs::write(large_object(&cache), [7; 10]).expect("writes");
    assert_damaged(&cache, "has 10 bytes instead of 3000");
}

#[test]
fn a_truncated_record_is_quarantined() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let record = files(&cache.folder().join("results")).remove(0);
    let text = fs::read(&record).expect("reads");
    fs::write(&record, &text[..text.len() / 2]).expect("writes");
    assert_damaged(&cache, "is no record");
}

#[test]
fn a_record_in_the_wrong_place_is_quarantined() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let record = files(&cache.folder().join("results")).remove(0);
    let text = fs::read_to_string(&record).expect("reads").replace(&key("k").hex(), &key("other").hex());
    fs::write(&record, text).expect("writes");
    assert_damaged(&cache, "is the record of another key");
}

#[test]
fn a_result_without_all_its_objects_does_not_count() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    fs::remove_file(large_object(&cache)).expect("removes");
    assert!(matches!(cache.get(&key("k")), Lookup::Miss));
}

#[test]
fn a_place_that_cannot_be_written_is_an_error_value() {
    // A file where the folder should be, which stops even the superuser.
    let dir = tempfile::tempdir().expect("tempdir");
    let root = dir.path().join("file");
    fs::write(&root, b"").expect("writes");
    let cache = Cache::new(&root);
    let error = cache.put(&key("k"), &entry()).expect_err("cannot write");
    assert!(error.to_string().starts_with("cache: cannot write "), "{error}");
    assert!(matches!(cache.get(&key("k")), Lookup::Damaged(StorageError::Io { .. })));
}

#[cfg(unix)]
#[test]
fn a_read_only_cache_still_gives_hits() {
    use std::os::unix::fs::PermissionsExt;
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let set = |mode| {
        for sub in ["", "objects", "results"] {
            fs::set_permissions(cache.folder().join(sub), fs::Permissions::from_mode(mode)).expect("chmod");
        }
    };
    set(0o555);
    let found = matches!(cache.get(&key("k")), Lookup::Hit(_));
    let new = cache.put(&key("new"), &Entry { objects: vec![("b".into(), vec![9; 50])] });
    let root_ignores_modes = fs::write(cache.folder().join("probe"), b"").is_ok();
    set(0o755);
    assert!(found);
    assert!(new.is_err() || root_ignores_modes);
}

#[test]
fn concurrent_writers_and_readers_see_whole_results() {
    let dir = tempfile::tempdir().expect("tempdir");
    let root = dir.path().join("cache");
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let cache = Cache::new(&root);
            scope.spawn(move || {
                for round in 0..20 {
                    cache.put(&key("k"), &entry()).expect("stores");
                    match cache.get(&key("k")) {
                        Lookup::Hit(found) => assert_eq!(found, entry()),
                        other => panic!("thread {thread}, round {round}: {other:?}"),
                    }
                }
            });
        }
    });
    let own = Cache::new(&root).folder().to_owned();
    let stored = ["objects", "results"].map(|folder| files(&own.join(folder)).len());
    assert_eq!((stored, files(&root).len()), ([2, 1], 6), "temporary files were left behind");
}
