//! A folder that several machines share.

use std::cell::RefCell;
use std::fs;
use std::path::Path;

use simpliguard::Cancellation;
use simpliguard::settings::CacheSettings;
use simpliguard_cache::{Cache, Entry, Explicit, Lookup, Once};

use crate::folder::{entry, files, key};

/// The cache of a machine.
fn machine(dir: &Path, name: &str, settings: &CacheSettings) -> Cache {
    let own = dir.join(name);
    Cache::of_project(Explicit { dir: Some(&own), shared: None }, settings, dir, |_| {}).expect("a folder is given")
}

fn shared(address: &str) -> CacheSettings {
    CacheSettings { shared: Some(address.into()), ..CacheSettings::default() }
}

/// A result from a cache, and what it told.
fn once(cache: &Cache, name: &str) -> (Once<Entry>, Vec<String>) {
    let told: RefCell<Vec<String>> = RefCell::default();
    let find = || if let Lookup::Hit(entry) = cache.get(&key(name)) { Some(entry) } else { None };
    let tell = |notice: simpliguard_cache::Notice| told.borrow_mut().push(notice.to_string());
    let make = || cache.put(&key(name), &entry()).map(|()| entry());
    let once = cache.once(&key(name), &Cancellation::default(), tell, find, make).expect("stores");
    (once, told.into_inner())
}

#[test]
fn what_one_machine_has_made_the_others_find() {
    let dir = tempfile::tempdir().expect("tempdir");
    fs::create_dir(dir.path().join("server")).expect("makes");
    let [a, b] = ["a", "b"].map(|name| machine(dir.path(), name, &shared("server")));
    assert_eq!(once(&a, "k"), (Once::Made(entry()), vec![]));
    assert_eq!(once(&b, "k"), (Once::Found(entry()), vec![]));
    // Stored here, it needs no server any more.
    fs::remove_dir_all(dir.path().join("server")).expect("removes");
    assert_eq!(once(&b, "k"), (Once::Found(entry()), vec![]));
}

#[test]
fn a_read_only_tier_is_left_as_it_is() {
    let dir = tempfile::tempdir().expect("tempdir");
    let server = dir.path().join("server");
    fs::create_dir(&server).expect("makes");
    once(&machine(dir.path(), "a", &shared("server")), "old");
    let before = files(&server);
    let reader = machine(dir.path(), "b", &CacheSettings { shared_read_only: true, ..shared("server") });
    assert_eq!(once(&reader, "old").0, Once::Found(entry()));
    assert_eq!(once(&reader, "new"), (Once::Made(entry()), vec![]));
    assert_eq!(files(&server), before);
}

#[test]
fn a_tier_that_is_not_there_is_told_of_once_and_costs_nothing() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = machine(dir.path(), "a", &shared("unmounted"));
    let (made, told) = once(&cache, "k");
    assert_eq!(made, Once::Made(entry()));
    assert_eq!(
        told,
        ["shared cache: cannot read from unmounted: there is no such folder; results stay on this machine: check the \
          address and your rights there"]
    );
    assert_eq!(once(&cache, "other"), (Once::Made(entry()), vec![]));
    assert!(!dir.path().join("unmounted").exists());
}

#[test]
fn damage_in_the_tier_does_not_come_here() {
    let dir = tempfile::tempdir().expect("tempdir");
    let server = dir.path().join("server");
    fs::create_dir(&server).expect("makes");
    once(&machine(dir.path(), "a", &shared("server")), "k");
    for object in files(&server.join("simpliguard-v1/objects")) {
        fs::write(object, b"rot").expect("writes");
    }
    let cache = machine(dir.path(), "b", &shared("server"));
    let (made, told) = once(&cache, "k");
    assert_eq!((made, told.len()), (Once::Made(entry()), 1), "{told:?}");
    assert!(told[0].contains("cannot read from server") && told[0].contains("bytes instead of"), "{told:?}");
    assert!(matches!(cache.get(&key("k")), Lookup::Hit(found) if found == entry()));
}

#[cfg(not(feature = "cloud"))]
#[test]
fn object_storage_needs_a_feature() {
    let dir = tempfile::tempdir().expect("tempdir");
    let (made, told) = once(&machine(dir.path(), "a", &shared("s3://levels")), "k");
    assert_eq!(made, Once::Made(entry()));
    assert!(told[0].contains("cannot read from s3://levels: this build knows folders only"), "{told:?}");
}
