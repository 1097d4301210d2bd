//! Files and folders of other programs, in and around a cache.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, SystemTime};

use simpliguard_cache::{Cache, Lookup, SingleFlight, StorageError};

use crate::folder::{age, entry, files, filled, flight, key, modified};

const DAY: Duration = Duration::from_secs(24 * 3600);

/// Writes a file of the user that is a month old.
fn old_file(path: PathBuf) {
    fs::create_dir_all(path.parent().expect("in a folder")).expect("makes");
    fs::write(&path, path.display().to_string()).expect("writes");
    let file = File::options().append(true).open(path).expect("opens");
    file.set_modified(SystemTime::now() - 30 * DAY).expect("sets the time");
}

/// Files in folders with the names of a cache's folders, some of them as in a git repository.
fn old_tree(root: &Path) {
    for folder in ["results", "objects", "stages", "locks", "quarantine"] {
        let names = ["plot.csv", "ab/notes.txt", "pack/pack-1.idx", ".simpliguard-x.tmp"].map(str::to_owned);
        let hashes = [38, 62].map(|digits| format!("ab/{}", "c".repeat(digits)));
        names.into_iter().chain(hashes).for_each(|name| old_file(root.join(folder).join(name)));
    }
    ["collecting", "estimate.json", "HEAD"].into_iter().for_each(|name| old_file(root.join(name)));
}

/// All files below a folder, with their contents and times.
fn snapshot(folder: &Path) -> BTreeMap<PathBuf, (Vec<u8>, SystemTime)> {
    let content = |path: PathBuf| {
        let seen = (fs::read(&path).expect("reads"), modified(&path));
        (path, seen)
    };
    files(folder).into_iter().map(content).collect()
}

/// Calls every operation of a cache.
fn use_in_every_way(cache: &Cache) {
    let _ = cache.put(&key("k"), &entry());
    cache.put_stage_object(&key("stage"), b"object");
    let make = |_: &_| cache.put(&key("other"), &entry());
    let _ = cache.single_flight(&flight(&key("other")), || None::<()>, |_| None, make);
    let _ = (cache.get(&key("k")), cache.get_stage_object(&key("stage")), cache.verify());
    let _ = (cache.collect(0), cache.clear(), cache.put(&key("k"), &entry()));
}

/// Asserts that nothing is found and nothing can be stored. Returns the error.
fn refusal(cache: &Cache) -> String {
    let before = snapshot(cache.root());
    let error = cache.put(&key("new"), &entry()).expect_err("is somebody else's");
    assert!(matches!(error, StorageError::Foreign { .. }), "{error}");
    assert!(matches!(cache.get(&key("k")), Lookup::Miss));
    assert_eq!(cache.get_stage_object(&key("stage")), None);
    assert!(cache.collect(0).is_err() && cache.clear().is_err() && cache.check().is_err());
    assert_eq!((cache.usage().bytes, cache.verify().checked.files), (0, 0));
    // A bake goes on without the cache.
    let outcome = cache.single_flight(&flight(&key("k")), || None, |_| None, |_| Ok::<_, ()>(1));
    assert_eq!(outcome, Ok(SingleFlight::Made(1)));
    use_in_every_way(cache);
    assert_eq!(snapshot(cache.root()), before);
    error.to_string()
}

#[test]
fn folders_beside_the_cache_that_are_named_like_its_own_are_left_alone() {
    let dir = tempfile::tempdir().expect("tempdir");
    for root in [dir.path().to_owned(), dir.path().join(".git")] {
        old_tree(&root);
        let before = snapshot(&root);
        let cache = Cache::new(&root).with_max_size(1);
        cache.put(&key("first"), &entry()).expect("stores");
        assert!(!files(cache.folder()).is_empty());
        use_in_every_way(&cache);
        cache.clear().expect("removes");
        assert!(!cache.folder().exists());
        assert_eq!(snapshot(&root), before);
    }
}

#[test]
fn foreign_files_in_the_folder_of_the_cache_stay() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let hash = "c".repeat(62);
    let names = ["readme.txt", "results/plot.csv", "results/ab/short", "objects/AB/x", "quarantine/mine", "more/x"];
    let mut foreign = names.map(|name| cache.folder().join(name)).to_vec();
    // As deep as ours, but folders; as ours, but in the wrong place or in capitals.
    foreign.push(cache.folder().join("objects/ab").join(&hash).join("x"));
    foreign.push(cache.folder().join("objects").join(&hash));
    foreign.push(cache.folder().join("stages/ab").join("C".repeat(62)));
    foreign.push(cache.folder().join("more/ab").join(&hash));
    foreign.push(cache.folder().join("quarantine").join(format!("{hash}.1")));
    foreign.iter().cloned().for_each(old_file);
    let usage = cache.usage();
    assert_eq!((usage.results.files, usage.objects.files, usage.quarantine.files), (1, 2, 0));
    assert_eq!(usage.bytes, cache.clear().expect("removes"));
    assert!(foreign.iter().all(|path| path.is_file()));
    assert_eq!(files(cache.folder()).len(), foreign.len() + 1, "all else but the marker is gone");
    // It is still a cache.
    use_in_every_way(&cache);
    cache.put(&key("k"), &entry()).expect("stores");
    age(&cache, DAY);
    cache.collect(0).expect("collects");
    assert_eq!(cache.usage().bytes, 0);
    assert!(foreign.iter().all(|path| path.is_file()));
}

#[test]
fn clearing_leaves_no_empty_folders() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put_stage_object(&key("stage"), b"object");
    fs::write(&files(&cache.folder().join("stages"))[0], b"rot").expect("writes");
    assert_eq!(cache.get_stage_object(&key("stage")), None);
    fs::write(cache.folder().join(".simpliguard-x.tmp"), b"half").expect("writes");
    cache.clear().expect("removes");
    assert_eq!(fs::read_dir(cache.root()).expect("lists").count(), 0);
    cache.put(&key("k"), &entry()).expect("stores");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(_)));
}

#[test]
fn a_folder_that_somebody_else_has_made_is_not_used() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    old_file(cache.folder().join("objects/ab").join("c".repeat(62)));
    let message = refusal(&cache);
    assert_eq!(
        message,
        format!(
            "cache: {} is not used: it holds 'objects' but no CACHEDIR.TAG of this program; delete or rename it, or \
             choose another folder for the cache",
            cache.folder().display()
        )
    );
    // As another program marks its own.
    let tag = cache.folder().join("CACHEDIR.TAG");
    fs::write(&tag, "Signature: 8a477f597d28d172789f06886806bc55\n# Made by another program.\n").expect("writes");
    refusal(&cache);
    fs::remove_dir_all(cache.folder()).expect("removes");
    fs::write(cache.folder(), "a file").expect("writes");
    assert!(refusal(&cache).contains("simpliguard-v1 is not used: it is a file; delete"));
}

#[test]
fn a_cache_that_lost_its_marker_is_not_touched_any_more() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put_stage_object(&key("stage"), b"object");
    age(&cache, DAY);
    fs::remove_file(cache.folder().join("CACHEDIR.TAG")).expect("removes");
    refusal(&cache);
    for path in files(cache.folder()) {
        fs::write(path, b"rot").expect("writes");
    }
    refusal(&cache);
}

#[test]
fn an_empty_folder_becomes_a_cache() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    for leftover in [None, Some(".simpliguard-a1B2c3.tmp")] {
        fs::create_dir(cache.folder()).expect("makes");
        // Of a process that was killed before it wrote the marker.
        leftover.into_iter().for_each(|name| old_file(cache.folder().join(name)));
        assert!(matches!(cache.get(&key("k")), Lookup::Miss));
        cache.put(&key("k"), &entry()).expect("stores");
        assert!(matches!(cache.get(&key("k")), Lookup::Hit(_)));
        let marker = fs::read_to_string(cache.folder().join("CACHEDIR.TAG")).expect("reads");
        assert!(marker.starts_with("Signature: 8a477f597d28d172789f06886806bc55\n# "), "{marker}");
        cache.collect(u64::MAX).expect("collects");
        assert!(!leftover.is_some_and(|name| cache.folder().join(name).exists()));
        cache.clear().expect("removes");
        assert!(!cache.folder().exists());
    }
}

#[test]
fn who_makes_the_folder_at_the_same_time_stores_too() {
    let dir = tempfile::tempdir().expect("tempdir");
    for round in 0..50 {
        let (root, start) = (dir.path().join(round.to_string()), Barrier::new(4));
        thread::scope(|scope| {
            for thread in 0..4 {
                let (cache, start) = (Cache::new(&root), &start);
                scope.spawn(move || {
                    start.wait();
                    cache.put(&key(&thread.to_string()), &entry()).expect("stores");
                });
            }
        });
        let cache = Cache::new(&root);
        assert!((0..4).all(|thread| matches!(cache.get(&key(&thread.to_string())), Lookup::Hit(_))));
    }
}

#[test]
fn a_folder_that_is_being_made_never_looks_like_somebody_elses() {
    let dir = tempfile::tempdir().expect("tempdir");
    for round in 0..150 {
        let (cache, stored) = (Cache::new(dir.path().join(round.to_string())), AtomicBool::new(false));
        thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    while !stored.load(Relaxed) {
                        cache.check().expect("is new or ours");
                    }
                });
            }
            cache.put_stage_object(&key("stage"), b"object");
            stored.store(true, Relaxed);
        });
        assert!(cache.get_stage_object(&key("stage")).is_some());
    }
}

#[test]
fn a_folder_that_is_moved_away_while_others_store_comes_back_with_its_marker() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path().join("cache"));
    thread::scope(|scope| {
        let storing = scope.spawn(|| {
            for i in 0..400 {
                cache.put_stage_object(&key(&(i % 50).to_string()), b"object");
            }
        });
        let mut moved = 0;
        while !storing.is_finished() {
            moved += u32::from(fs::rename(cache.folder(), dir.path().join(moved.to_string())).is_ok());
        }
    });
    let moved = fs::read_dir(dir.path()).expect("lists").map(|entry| entry.expect("lists").path());
    let unmarked = |path: &PathBuf| {
        let mut files = files(path).into_iter().filter(|file| !file.to_string_lossy().ends_with(".tmp")).peekable();
        files.peek().is_some() && !path.join("CACHEDIR.TAG").exists()
    };
    assert_eq!(moved.filter(|path| !path.ends_with("cache")).find(unmarked), None);
    cache.put(&key("k"), &entry()).expect("stores");
}

#[test]
fn a_cache_that_is_cleared_or_deleted_while_others_store_stays_a_cache() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    thread::scope(|scope| {
        let storing = scope.spawn(|| {
            for i in 0..300 {
                // May fail while the marker goes.
                let _ = cache.put(&key(&(i % 7).to_string()), &entry());
            }
        });
        while !storing.is_finished() {
            let _ = cache.clear();
        }
    });
    cache.put(&key("k"), &entry()).expect("stores");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(_)));
    cache.clear().expect("removes");
    assert!(!cache.folder().exists());
}

#[cfg(unix)]
#[test]
fn nothing_is_done_through_symbolic_links() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().expect("tempdir");
    let elsewhere = dir.path().join("elsewhere");
    let hex = key("k").hex();
    let (first, rest) = hex.split_at(2);
    old_tree(&elsewhere);
    for folder in ["results", "stages", "locks", "objects"] {
        old_file(elsewhere.join(folder).join(first).join(rest));
    }
    old_file(elsewhere.join("marker"));
    let before = snapshot(&elsewhere);
    // Each folder of a cache in turn, one below it, and one file.
    let own = |cache: &Cache, name: &str| cache.folder().join(name);
    let names = ["results", "objects", "stages", "locks", "quarantine", "collecting", "estimate.json"];
    let deep = [format!("results/{first}"), format!("results/{first}/{rest}"), "objects/ab".into()];
    for name in names.map(str::to_owned).into_iter().chain(deep) {
        let cache = filled(dir.path());
        age(&cache, DAY);
        let link = own(&cache, &name);
        let _ = fs::remove_dir_all(&link).or_else(|_| fs::remove_file(&link));
        symlink(elsewhere.join(&name), &link).expect("links");
        let _ = cache.clear();
        assert!(link.is_symlink(), "{name}");
        use_in_every_way(&cache);
        assert_eq!(snapshot(&elsewhere), before, "{name}");
        fs::remove_dir_all(cache.root()).expect("removes");
    }
    // The whole folder, and its marker.
    let cache = Cache::new(dir.path().join("cache"));
    fs::create_dir(cache.root()).expect("makes");
    symlink(&elsewhere, cache.folder()).expect("links");
    assert!(refusal(&cache).contains("simpliguard-v1 is not used: it is a symbolic link; delete"));
    fs::remove_file(cache.folder()).expect("removes");
    cache.put(&key("k"), &entry()).expect("stores");
    let marker = own(&cache, "CACHEDIR.TAG");
    fs::rename(&marker, elsewhere.join("marker")).expect("moves");
    symlink(elsewhere.join("marker"), &marker).expect("links");
    refusal(&cache);
}

#[cfg(unix)]
#[test]
fn storing_through_a_link_says_which() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let results = cache.folder().join("results");
    fs::remove_dir_all(&results).expect("removes");
    symlink(dir.path(), &results).expect("links");
    let message = cache.put(&key("k"), &entry()).expect_err("a link").to_string();
    assert!(message.contains("results is not used: it is a symbolic link; delete or rename it"), "{message}");
}
