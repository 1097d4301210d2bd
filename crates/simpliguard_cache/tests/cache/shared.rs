//! A folder that several machines share.

use std::cell::RefCell;
use std::fs;
use std::path::Path;

use simpliguard_cache::{Cache, Entry, Flight, Lookup, Notice, SingleFlight};

use crate::folder::{entry, files, flight, key};

/// The cache of a machine, with a shared tier at `address`.
fn machine(dir: &Path, name: &str, address: &str) -> Cache {
    Cache::new(dir.join(name)).with_shared_tier(address, dir, false)
}

/// A result from a cache, and the notices on the way.
fn single_flight(cache: &Cache, name: &str) -> (SingleFlight<Entry>, Vec<String>) {
    let notices: RefCell<Vec<String>> = RefCell::default();
    let find = || if let Lookup::Hit(entry) = cache.get(&key(name)) { Some(entry) } else { None };
    let notify = |notice: Notice| notices.borrow_mut().push(notice.to_string());
    let make = |_: &_| cache.put(&key(name), &entry()).map(|()| entry());
    let outcome =
        cache.single_flight(&Flight { notify: &notify, ..flight(&key(name)) }, find, Some, make).expect("stores");
    (outcome, notices.into_inner())
}

#[test]
fn what_one_machine_has_made_the_others_find() {
    let dir = tempfile::tempdir().expect("tempdir");
    fs::create_dir(dir.path().join("server")).expect("makes");
    let [a, b] = ["a", "b"].map(|name| machine(dir.path(), name, "server"));
    assert_eq!(single_flight(&a, "k"), (SingleFlight::Made(entry()), vec![]));
    assert_eq!(single_flight(&b, "k"), (SingleFlight::Found(entry()), vec![]));
    // Stored here, it needs no server any more.
    fs::remove_dir_all(dir.path().join("server")).expect("removes");
    assert_eq!(single_flight(&b, "k"), (SingleFlight::Found(entry()), vec![]));
}

#[test]
fn a_read_only_tier_is_left_as_it_is() {
    let dir = tempfile::tempdir().expect("tempdir");
    let server = dir.path().join("server");
    fs::create_dir(&server).expect("makes");
    single_flight(&machine(dir.path(), "a", "server"), "old");
    let before = files(&server);
    let reader = Cache::new(dir.path().join("b")).with_shared_tier("server", dir.path(), true);
    assert_eq!(single_flight(&reader, "old").0, SingleFlight::Found(entry()));
    assert_eq!(single_flight(&reader, "new"), (SingleFlight::Made(entry()), vec![]));
    assert_eq!(files(&server), before);
}

#[test]
fn a_tier_that_is_not_there_is_told_of_once_and_costs_nothing() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = machine(dir.path(), "a", "unmounted");
    let (made, notices) = single_flight(&cache, "k");
    assert_eq!(made, SingleFlight::Made(entry()));
    assert_eq!(
        notices,
        ["shared cache: cannot read from unmounted: there is no such folder; results stay on this machine: check the \
          address and your rights there"]
    );
    assert_eq!(single_flight(&cache, "other"), (SingleFlight::Made(entry()), vec![]));
    assert!(!dir.path().join("unmounted").exists());
}

#[test]
fn damage_in_the_tier_does_not_come_here() {
    let dir = tempfile::tempdir().expect("tempdir");
    let server = dir.path().join("server");
    fs::create_dir(&server).expect("makes");
    single_flight(&machine(dir.path(), "a", "server"), "k");
    for object in files(&server.join("simpliguard-v1/objects")) {
        fs::write(object, b"rot").expect("writes");
    }
    let cache = machine(dir.path(), "b", "server");
    let (made, notices) = single_flight(&cache, "k");
    assert_eq!((made, notices.len()), (SingleFlight::Made(entry()), 1), "{notices:?}");
    assert!(notices[0].contains("cannot read from server") && notices[0].contains("bytes instead of"), "{notices:?}");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(found) if found == entry()));
}

#[cfg(not(feature = "cloud"))]
#[test]
fn object_storage_needs_a_feature() {
    let dir = tempfile::tempdir().expect("tempdir");
    let (made, notices) = single_flight(&machine(dir.path(), "a", "s3://levels"), "k");
    assert_eq!(made, SingleFlight::Made(entry()));
    assert!(notices[0].contains("s3://levels cannot be used: this build knows folders only"), "{notices:?}");
}

#[test]
fn a_forged_result_is_neither_used_nor_stored() {
    let dir = tempfile::tempdir().expect("tempdir");
    fs::create_dir(dir.path().join("server")).expect("makes");
    single_flight(&machine(dir.path(), "a", "server"), "k");
    let cache = machine(dir.path(), "b", "server");
    let notices: RefCell<Vec<String>> = RefCell::default();
    let key = key("k");
    let request = Flight {
        notify: &|notice: Notice| notices.borrow_mut().push(notice.to_string()),
        check: |_| Err("is not the result of a bake".into()),
        ..flight(&key)
    };
    let find = || if let Lookup::Hit(entry) = cache.get(&key) { Some(entry) } else { None };
    let outcome = cache.single_flight(&request, find, |_| panic!("was taken"), |_| Err::<Entry, _>("made"));
    assert_eq!(outcome, Err("made"));
    assert!(matches!(cache.get(&key), Lookup::Miss));
    let notices = notices.into_inner();
    assert!(notices.len() == 1 && notices[0].contains("is not the result of a bake"), "{notices:?}");
}

#[test]
fn a_cache_that_cannot_be_written_still_uses_shared_results() {
    let dir = tempfile::tempdir().expect("tempdir");
    fs::create_dir(dir.path().join("server")).expect("makes");
    single_flight(&machine(dir.path(), "a", "server"), "k");
    // No folder can be created below a file, whatever rights the test has.
    fs::write(dir.path().join("file"), "").expect("writes");
    let (found, notices) = single_flight(&machine(dir.path(), "file", "server"), "k");
    assert_eq!(found, SingleFlight::Found(entry()));
    assert!(notices.len() == 1 && notices[0].starts_with("the result is not kept: cache: cannot write"), "{notices:?}");
}
