//! The size of a cache, and what goes when it is reached.

use std::fs;
use std::time::{Duration, SystemTime};

use simpliguard_cache::{Cache, Collected, Entry, Lookup};

use crate::folder::{age, entry, files, filled, key, modified};

const HOUR: Duration = Duration::from_secs(3600);
const KIB: u64 = 1024;

/// An entry with an object of its own of 10 KiB, and one that all have.
fn large(i: u8) -> Entry {
    let objects = vec![("own".to_owned(), vec![i; 10 * KIB as usize]), ("shared".to_owned(), vec![0; 100])];
    Entry { objects }
}

fn is_hit(cache: &Cache, name: &str) -> bool {
    matches!(cache.get(&key(name)), Lookup::Hit(_))
}

fn collect(cache: &Cache, max_size: u64) -> Collected {
    cache.collect(max_size).expect("writable").expect("no other collection")
}

#[test]
fn what_was_used_longest_ago_goes_first() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    for (i, name) in (0..).zip(["a", "b", "c", "d"]) {
        cache.put(&key(name), &large(i)).expect("stores");
        age(&cache, 2 * HOUR);
    }
    assert!(is_hit(&cache, "a"));
    let done = collect(&cache, 24 * KIB);
    assert_eq!(done.results, 2);
    assert!(done.left <= 24 * KIB && done.freed > 20 * KIB, "{done:?}");
    assert_eq!(["a", "b", "c", "d"].map(|name| is_hit(&cache, name)), [true, false, false, true]);
    assert_eq!(cache.usage().bytes, done.left);
}

#[test]
fn storing_keeps_a_cache_below_its_limit() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path()).with_max_size(64 * KIB);
    for i in 0..40u8 {
        cache.put(&key(&i.to_string()), &large(i)).expect("stores");
        age(&cache, HOUR);
        // One is over the limit until it is collected.
        assert!(cache.usage().bytes < 76 * KIB, "{:?}", cache.usage());
    }
    let left = (0..40).filter(|i| is_hit(&cache, &i.to_string())).count();
    assert!((4..=6).contains(&left) && is_hit(&cache, "39"), "{left}");
}

#[test]
fn files_are_counted_only_when_the_limit_seems_to_be_reached() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path()).with_max_size(1000 * KIB);
    cache.put(&key("a"), &large(0)).expect("stores");
    // Nobody who counts could miss it.
    let uncounted = cache.folder().join("objects/ab").join("c".repeat(62));
    fs::create_dir_all(uncounted.parent().expect("in a folder")).expect("makes");
    fs::write(uncounted, vec![0; 2000 * KIB as usize]).expect("writes");
    let collecting = cache.folder().join("collecting");
    let before = modified(&collecting);
    for i in 1..10 {
        cache.put(&key(&i.to_string()), &large(i)).expect("stores");
    }
    assert_eq!(modified(&collecting), before);
}

#[test]
fn objects_of_stages_go_before_results() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    age(&cache, 3 * HOUR);
    cache.put_stage_object(&key("stage"), &vec![1; 20 * KIB as usize]);
    assert_eq!(cache.get_stage_object(&key("stage")).map(|object| object.len()), Some(20 * KIB as usize));
    let done = collect(&cache, 10 * KIB);
    assert_eq!((done.stages, done.results), (1, 0));
    assert_eq!(cache.get_stage_object(&key("stage")), None);
    assert!(is_hit(&cache, "k"));
}

#[test]
fn what_nobody_can_use_goes_once_it_is_old() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    // A writer that was killed: a temporary file, and objects whose record never came.
    cache.put(&key("new"), &large(1)).expect("stores");
    let record = files(&cache.folder().join("results")).into_iter().find(|p| !p.ends_with(&key("k").hex()[2..]));
    fs::remove_file(record.expect("two records")).expect("removes");
    let folder = files(&cache.folder().join("objects"))[0].parent().expect("in a folder").to_owned();
    fs::write(folder.join(".simpliguard-x.tmp"), b"half").expect("writes");
    fs::create_dir_all(cache.folder().join("locks/ab")).expect("makes");
    fs::write(cache.folder().join("locks/ab").join("c".repeat(62)), b"").expect("writes");
    assert_eq!(cache.usage().unreferenced.files, 2);
    // Young, they may be somebody's who is still at work.
    assert_eq!(collect(&cache, u64::MAX).freed, 0);
    age(&cache, HOUR);
    let done = collect(&cache, u64::MAX);
    assert_eq!((done.freed, done.results), (10 * KIB + 100 + 4, 0));
    assert_eq!(files(&cache.folder().join("locks")).len(), 0);
    assert!(is_hit(&cache, "k"));
}

#[test]
fn an_object_that_is_stored_again_is_not_taken_from_its_new_result() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    age(&cache, HOUR);
    // The objects are there already; of the new result, the record is still to come.
    cache.put(&key("new"), &entry()).expect("stores");
    for record in files(&cache.folder().join("results")) {
        fs::remove_file(record).expect("removes");
    }
    collect(&cache, 0);
    assert_eq!(files(&cache.folder().join("objects")).len(), 2);
}

#[test]
fn a_result_that_lost_an_object_goes_and_its_others_with_it() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    fs::remove_file(&files(&cache.folder().join("objects"))[0]).expect("removes");
    assert_eq!(cache.usage().incomplete.files, 1);
    age(&cache, HOUR);
    let done = collect(&cache, u64::MAX);
    assert_eq!((done.results, cache.usage().bytes), (1, 0));
}

#[test]
fn a_use_is_noted_once_an_hour() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    let record = files(&cache.folder().join("results")).remove(0);
    age(&cache, HOUR / 2);
    let before = modified(&record);
    assert!(is_hit(&cache, "k") && modified(&record) == before);
    age(&cache, HOUR);
    assert!(is_hit(&cache, "k") && modified(&record) > before);
}

#[test]
fn clearing_removes_what_the_cache_has_made_and_nothing_else() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put_stage_object(&key("stage"), b"object");
    let readme = cache.root().join("readme.txt");
    fs::write(&readme, "the user's").expect("writes");
    let bytes = cache.usage().bytes;
    assert_eq!(cache.clear().expect("removes"), bytes);
    assert_eq!(files(cache.root()), [readme]);
    assert_eq!(cache.clear().expect("is empty"), 0);
}

#[test]
fn collecting_where_there_is_no_cache_makes_none() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path().join("none"));
    assert_eq!(collect(&cache, 0), Collected::default());
    assert!(!cache.root().exists());
}

/// Sets the times of all files of a cache to ten days from now.
fn postdate(cache: &Cache) {
    for path in files(cache.folder()) {
        let file = fs::File::options().append(true).open(path).expect("opens");
        file.set_modified(SystemTime::now() + 240 * HOUR).expect("sets the time");
    }
}

#[test]
fn results_from_the_future_go_last_but_go() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    cache.put(&key("future"), &large(0)).expect("stores");
    cache.put_stage_object(&key("stage"), b"object");
    postdate(&cache);
    let postdated = files(cache.folder());
    cache.put(&key("past"), &large(1)).expect("stores");
    for path in files(cache.folder()).into_iter().filter(|path| !postdated.contains(path)) {
        let file = fs::File::options().append(true).open(path).expect("opens");
        file.set_modified(SystemTime::now() - HOUR).expect("sets the time");
    }
    let record = |name: &str| cache.folder().join("results").join(&key(name).hex()[..2]).join(&key(name).hex()[2..]);
    assert_eq!(collect(&cache, 16 * KIB).results, 1);
    assert!(record("future").exists() && !record("past").exists());
    assert_eq!(collect(&cache, 0).results, 1);
    // The object that both have was used just now.
    let left = files(&cache.folder().join("objects"));
    assert!(
        left.iter().all(|path| modified(path).elapsed().is_ok_and(|age| age < HOUR)) && left.len() <= 1,
        "{left:?}"
    );
    assert_eq!(cache.usage().stages.files, 0);
}

#[test]
fn what_nobody_can_use_goes_with_a_date_in_the_future_too() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put_stage_object(&key("stage"), b"object");
    fs::write(&files(&cache.folder().join("stages"))[0], b"rot").expect("writes");
    assert_eq!(cache.get_stage_object(&key("stage")), None);
    for record in files(&cache.folder().join("results")) {
        fs::remove_file(record).expect("removes");
    }
    let folder = files(&cache.folder().join("objects"))[0].parent().expect("in a folder").to_owned();
    fs::write(folder.join(".simpliguard-x.tmp"), b"half").expect("writes");
    fs::create_dir_all(cache.folder().join("locks/ab")).expect("makes");
    fs::write(cache.folder().join("locks/ab").join("c".repeat(62)), b"").expect("writes");
    postdate(&cache);
    assert_eq!(collect(&cache, u64::MAX).left, 0);
    assert_eq!((cache.usage().bytes, files(&cache.folder().join("locks")).len()), (0, 0));
}

#[test]
fn an_estimate_that_cannot_be_true_means_a_count() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path()).with_max_size(64 * KIB);
    let estimate = cache.folder().join("estimate.json");
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970").as_secs();
    for (i, (bytes, counted)) in (0..).zip([(0, u64::MAX), (0, now + 1000), (u64::MAX, now), (u64::MAX, 0)]) {
        cache.put(&key(&i.to_string()), &large(i)).expect("stores");
        fs::write(&estimate, format!("{{\"bytes\": {bytes}, \"counted\": {counted}}}")).expect("writes");
        cache.put(&key("next"), &large(100 + i)).expect("stores");
        let known: serde_json::Value = serde_json::from_slice(&fs::read(&estimate).expect("reads")).expect("JSON");
        assert_eq!(known["bytes"], cache.usage().bytes, "{bytes} {counted}");
    }
}

#[test]
fn verifying_finds_every_kind_of_damage() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = filled(dir.path());
    cache.put(&key("whole"), &large(1)).expect("stores");
    cache.put_stage_object(&key("stage"), b"object");
    let verified = cache.verify();
    assert!(verified.errors.is_empty() && verified.incomplete == 0, "{verified:?}");
    assert_eq!(verified.checked.files, 2 + 4 + 1);
    let object = files(&cache.folder().join("objects"))
        .into_iter()
        .find(|path| fs::metadata(path).expect("exists").len() == 3000)
        .expect("the large object");
    let stage = files(&cache.folder().join("stages")).remove(0);
    for path in [object, stage] {
        let mut bytes = fs::read(&path).expect("reads");
        *bytes.last_mut().expect("not empty") ^= 1;
        fs::write(&path, bytes).expect("writes");
    }
    let verified = cache.verify();
    assert_eq!((verified.errors.len(), verified.incomplete), (2, 1), "{verified:?}");
    assert_eq!(cache.usage().quarantine.files, 2);
    assert!(cache.verify().errors.is_empty() && is_hit(&cache, "whole") && !is_hit(&cache, "k"));
}

#[test]
fn thousands_of_results_are_counted_and_collected() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    cache.put(&key("seed"), &large(0)).expect("stores");
    let [objects, results] = ["objects", "results"].map(|folder| files(&cache.folder().join(folder)));
    // Records of the same objects, as quick as files can be written.
    let json = fs::read_to_string(&results[0]).expect("reads");
    for i in 0..3000 {
        let hex = key(&format!("result {i}")).hex();
        let folder = cache.folder().join("results").join(&hex[..2]);
        fs::create_dir_all(&folder).expect("makes");
        fs::write(folder.join(&hex[2..]), json.replace(&key("seed").hex(), &hex)).expect("writes");
    }
    let usage = cache.usage();
    assert_eq!((usage.results.files, usage.incomplete.files, usage.objects.files), (3001, 0, objects.len() as u64));
    assert!(is_hit(&cache, "result 2999"));
    age(&cache, HOUR);
    let done = collect(&cache, usage.bytes / 2);
    assert!(done.results > 1000 && done.left <= usage.bytes / 2, "{done:?}");
    // What the rest shares is still there.
    assert_eq!(cache.usage().incomplete.files, 0);
}
