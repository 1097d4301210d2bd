//! Folders that go away, move, or have no room.

use std::fs;

use simpliguard_cache::{Cache, Entry, Lookup};

use crate::folder::{entry, files, filled, key};

#[test]
fn a_folder_that_is_deleted_while_in_use_is_made_again() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    fs::remove_dir_all(cache.root()).expect("removes");
    assert!(matches!(cache.get(&key("k")), Lookup::Miss));
    assert_eq!(cache.get_stage_object(&key("k")), None);
    assert_eq!((cache.usage().bytes, cache.verify().errors.len()), (0, 0));
    cache.put(&key("k"), &entry()).expect("stores");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(_)));
}

#[test]
fn a_cache_that_is_moved_keeps_its_results() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put_stage_object(&key("stage"), b"object");
    let moved = Cache::new(dir.path().join("elsewhere"));
    fs::rename(cache.root(), moved.root()).expect("moves");
    assert!(matches!(moved.get(&key("k")), Lookup::Hit(found) if found == entry()));
    assert!(moved.get_stage_object(&key("stage")).is_some());
}

#[test]
fn nothing_in_a_cache_names_a_path() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put_stage_object(&key("stage"), b"object");
    let folder = dir.path().to_str().expect("UTF-8").as_bytes().to_vec();
    for file in files(cache.root()) {
        let bytes = fs::read(&file).expect("reads");
        assert!(!bytes.windows(folder.len()).any(|part| part == folder), "{}", file.display());
        // No separator of paths either, wherever they begin.
        let json = file.starts_with(cache.folder().join("results"));
        assert!(!json || !bytes.iter().any(|byte| b"/\\".contains(byte)), "{}", file.display());
    }
}

#[test]
fn damaged_objects_of_stages_are_misses() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    for damage in [&b""[..], b"short", &[0; 100]] {
        cache.put_stage_object(&key("stage"), b"object");
        let file = files(&cache.folder().join("stages")).remove(0);
        fs::write(&file, damage).expect("writes");
        assert_eq!(cache.get_stage_object(&key("stage")), None);
        assert!(!file.exists());
    }
    assert_eq!(cache.stats().quarantined, 3);
}

/// Set in a process whose files may not grow.
#[cfg(unix)]
const FULL: &str = "SIMPLIGUARD_TEST_FULL_DISK";

#[cfg(unix)]
#[test]
fn a_full_disk_is_an_error_value_and_leaves_nothing() {
    use std::process::Command;

    if let Some(root) = std::env::var_os(FULL) {
        return with_a_full_disk(&Cache::new(root));
    }
    let dir = tempfile::tempdir().expect("tempdir");
    // No file of more than 16 blocks of 512 bytes can be written; the signal that would end the process is ignored.
    let script =
        "trap '' XFSZ; ulimit -f 16; exec \"$0\" --exact trouble::a_full_disk_is_an_error_value_and_leaves_nothing";
    let test = std::env::current_exe().expect("is a test");
    let output = Command::new("sh").args(["-c", script]).arg(test).env(FULL, dir.path()).output().expect("starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
}

#[cfg(unix)]
fn with_a_full_disk(cache: &Cache) {
    let objects = vec![("small".to_owned(), vec![1; 100]), ("large".to_owned(), vec![2; 100_000])];
    let error = cache.put(&key("large"), &Entry { objects }).expect_err("cannot be written");
    assert!(error.to_string().starts_with("cache: cannot write "), "{error}");
    cache.put_stage_object(&key("stage"), &[3; 100_000]);
    assert_eq!(cache.get_stage_object(&key("stage")), None);
    assert!(matches!(cache.get(&key("large")), Lookup::Miss));
    let whole = |path: &std::path::PathBuf| fs::metadata(path).expect("exists").len() == 100;
    assert!(files(&cache.folder().join("objects")).iter().all(whole), "half a file was left behind");
    cache.put(&key("k"), &entry()).expect("what fits is stored");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(_)));
}
