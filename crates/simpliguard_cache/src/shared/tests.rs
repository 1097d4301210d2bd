//! A tier in memory that hangs, fails and forges.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};
use std::thread;

use blake3::Hash;
use simpliguard_key::{Key, KeyBuilder, content_hash};

use super::*;
use crate::flight::Notice;
use crate::record::{MOST_RECORD_BYTES, ObjectRecord, Record};
use crate::signature::SecretKey;
use crate::single_flight::SingleFlight;
use crate::store::{Cache, Lookup};
use crate::tier::Fault;

const PATIENCE: Patience = Patience { request: Duration::from_millis(200), bytes_per_second: u64::MAX };

/// In place of the name of a request.
const EVERYTHING: &str = "everything";

/// Files in memory.
#[derive(Debug, Default)]
struct Memory {
    files: Mutex<BTreeMap<String, Vec<u8>>>,
    /// The request that never returns, or [`EVERYTHING`].
    stuck: Option<&'static str>,
    /// Time that every answer takes.
    delay: Duration,
    /// The request that is denied.
    denied: Option<&'static str>,
    /// The number of requests that fail before the others are answered.
    failing: AtomicU32,
}

impl Memory {
    fn answer<T>(&self, request: &str, answer: impl FnOnce(&mut BTreeMap<String, Vec<u8>>) -> T) -> T {
        if self.stuck.is_some_and(|stuck| stuck == request || stuck == EVERYTHING) {
            thread::sleep(Duration::from_secs(3600));
        }
        thread::sleep(self.delay);
        answer(&mut self.files.lock().expect("sound"))
    }

    fn put(&self, request: &'static str, name: String, bytes: &[u8], there: There) -> Result<(), Fault> {
        if self.denied == Some(request) {
            return Err(Fault::Denied("no right".into()));
        }
        self.answer(request, |files| {
            if there == There::Bad || !files.contains_key(&name) {
                files.insert(name, bytes.to_vec());
            }
        });
        Ok(())
    }
}

impl Tier for Memory {
    fn probe(&self, write: bool) -> Result<(), Fault> {
        let answer = |denied: &str| Err(Fault::Denied(denied.to_owned()));
        self.denied.filter(|denied| *denied == "probe" || write).map_or(Ok(()), answer)
    }

    fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, Fault> {
        assert_eq!(most, MOST_RECORD_BYTES);
        if self.failing.fetch_update(SeqCst, SeqCst, |left| left.checked_sub(1)).is_ok() {
            return Err(Fault::Failed("the network is down".into()));
        }
        self.answer("record", |files| Ok(files.get(&key.hex()).cloned()))
    }

    fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, Fault> {
        assert!(bytes.end - bytes.start <= 4 << 20, "a request for {bytes:?}");
        let part = |file: &Vec<u8>| file[bytes.start as usize..file.len().min(bytes.end as usize)].to_vec();
        self.answer("part", |files| Ok(files.get(object.to_hex().as_str()).map(part)))
    }

    fn has_object(&self, object: &Hash, size: u64) -> Result<bool, Fault> {
        let is_whole = |file: &Vec<u8>| file.len() as u64 == size;
        self.answer("has_object", |files| Ok(files.get(object.to_hex().as_str()).is_some_and(is_whole)))
    }

    fn put_object(&self, object: &Hash, bytes: &[u8], there: There) -> Result<(), Fault> {
        self.put("put_object", object.to_string(), bytes, there)
    }

    fn put_record(&self, key: &Key, json: &[u8], there: There) -> Result<(), Fault> {
        self.put("put_record", key.hex(), json, there)
    }

    fn set_aside(&self, damaged: Damaged, reason: &str) -> String {
        format!("{damaged:?} {reason}")
    }
}

fn key() -> Key {
    KeyBuilder::new("test").finish()
}

fn entry() -> Entry {
    Entry { objects: vec![("a".into(), b"content".to_vec()), ("empty".into(), vec![]), ("b".into(), vec![7; 9 << 20])] }
}

fn shared(tier: Memory) -> Shared {
    Shared::new("server", Ok(Arc::new(tier)), false, Trust::default()).with_patience(PATIENCE)
}

fn get(shared: &Shared) -> Result<Option<Entry>, String> {
    shared.get(&key(), |_| Ok(true)).map_err(|e| e.to_string())
}

fn put(shared: &Shared) -> Result<(), String> {
    shared.put(&flight(&key()), entry()).map_err(|e| e.to_string())
}

fn flight(key: &Key) -> Flight<'_> {
    Flight { key, is_cancelled: &|| false, notify: &|_| {}, check: |_| Ok(true) }
}

#[test]
fn results_come_back_in_parts() {
    let shared = shared(Memory::default());
    assert_eq!(get(&shared), Ok(None));
    put(&shared).expect("stores");
    assert_eq!(get(&shared), Ok(Some(entry())));
}

#[test]
fn a_result_is_there_if_all_its_objects_are() {
    let memory = Arc::new(Memory::default());
    let shared = Shared::new("server", Ok(memory.clone()), false, Trust::default()).with_patience(PATIENCE);
    let has = || shared.has(&flight(&key())).expect("answers");
    assert!(!has());
    put(&shared).expect("stores");
    assert!(has());
    memory.files.lock().expect("sound").insert(content_hash(b"content").to_string(), b"short".to_vec());
    assert!(!has());
}

#[test]
fn a_tier_that_hangs_costs_one_warning_and_one_wait() {
    for stuck in ["record", "part", "put_object", "put_record"] {
        let memory = Memory { stuck: Some(stuck), ..Memory::default() };
        let objects = vec![ObjectRecord { name: "a".into(), hash: content_hash(b"x"), size: 1 }];
        let record = Record::new(&key(), objects).to_json().expect("serialises");
        memory.files.lock().expect("sound").insert(key().hex(), record);
        let shared = shared(memory);
        let start = Instant::now();
        let puts = stuck.starts_with("put");
        let ask = || if puts { put(&shared).err() } else { get(&shared).err() };
        let errors: Vec<String> = (0..50).filter_map(|_| ask()).collect();
        assert_eq!(
            errors,
            ["shared cache: server has not answered for 0.2 seconds and is not asked again in this run; results stay \
              on this machine: check the connection"]
        );
        assert!(start.elapsed() < Duration::from_secs(5), "{stuck}");
    }
}

#[test]
fn of_many_threads_that_wait_one_warns() {
    let shared = shared(Memory { stuck: Some("record"), ..Memory::default() });
    let errors = thread::scope(|scope| {
        let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| get(&shared).is_err())).collect();
        threads.into_iter().map(|thread| thread.join().expect("ends")).filter(|is_error| *is_error).count()
    });
    assert_eq!(errors, 1);
}

#[test]
fn a_wait_for_the_tier_can_be_cancelled() {
    let stuck = Arc::new(Memory { stuck: Some("record"), ..Memory::default() });
    let shared = Shared::new("server", Ok(stuck), false, Trust::default());
    let start = Instant::now();
    let key = key();
    let flight = Flight { is_cancelled: &|| true, ..flight(&key) };
    assert!(!shared.has(&flight).expect("no warning"));
    assert!(start.elapsed() < Duration::from_secs(5));
}

/// A cache in a folder with a tier in memory.
fn cache(folder: &Path, memory: Memory) -> Cache {
    Cache::new(folder).with_shared(Shared::new("server", Ok(Arc::new(memory)), false, Trust::default()))
}

#[test]
fn whichever_comes_first_is_taken_the_result_of_the_tier_or_of_the_maker() {
    let dir = tempfile::tempdir().expect("tempdir");
    let memory = Memory { delay: HEAD_START, ..Memory::default() };
    let cache = cache(dir.path(), memory);
    let key = key();
    let find = || if let Lookup::Hit(entry) = cache.get(&key) { Some(entry) } else { None };
    cache.shared().expect("has a tier").put(&flight(&key), entry()).expect("stores");
    let begun = Cell::new(false);
    // A maker that never ends by itself.
    let make = |arrived: &Arc<AtomicBool>| {
        begun.set(true);
        while !arrived.load(Relaxed) {
            thread::sleep(Duration::from_millis(1));
        }
        Err("stopped")
    };
    let found = cache.single_flight(&flight(&key), find, Some, make);
    assert_eq!((found, begun.get()), (Ok(SingleFlight::Found(entry())), true));
    assert_eq!(find(), Some(entry()));
    cache.clear().expect("clears");
    let quick = cache.single_flight(&flight(&key), find, Some, |_| Ok::<_, ()>(entry()));
    assert_eq!(quick, Ok(SingleFlight::Made(entry())));
}

#[test]
fn a_tier_that_is_stuck_delays_no_run_and_is_told_of_once() {
    let small = Entry { objects: vec![("a".into(), vec![7; 9])] };
    for stuck in [EVERYTHING, "put_object"] {
        let dir = tempfile::tempdir().expect("tempdir");
        let cache = cache(dir.path(), Memory { stuck: Some(stuck), ..Memory::default() }).with_background_uploads();
        let start = Instant::now();
        let told = RefCell::new(Vec::new());
        let notify = |notice: Notice| told.borrow_mut().push(notice.to_string());
        for name in ["a", "b", "c", "d", "e"] {
            let key = KeyBuilder::new(name).finish();
            let flight = Flight { notify: &notify, ..flight(&key) };
            let make = |_: &_| cache.put(&key, &small).map(|()| small.clone());
            let made = cache.single_flight(&flight, || None, Some, make);
            assert_eq!(made.expect("stores"), SingleFlight::Made(small.clone()));
        }
        told.borrow_mut().extend(cache.finish().1.iter().map(ToString::to_string));
        let told = told.into_inner();
        assert!(told.len() == 1 && told[0].contains("server has not answered for"), "{stuck}: {told:?}");
        // The time limit of the first request alone would be longer.
        assert!(start.elapsed() < Patience::default().request / 2, "{stuck}");
    }
}

#[test]
fn what_the_caller_refuses_is_not_found() {
    let shared = shared(Memory::default());
    put(&shared).expect("stores");
    assert_eq!(shared.get(&key(), |_| Ok(false)).expect("is sound"), None);
    let error = shared.get(&key(), |_| Err("is no model".into())).expect_err("refused");
    assert!(error.to_string().contains("is no model"), "{error}");
}

#[test]
fn records_that_ask_for_too_much_are_refused_before_anything_is_read() {
    let huge = |size| ObjectRecord { name: format!("{size}"), hash: content_hash(b"x"), size };
    for objects in [vec![huge(u64::MAX)], vec![huge(3 << 30), huge(2 << 30)], vec![huge(1), huge(1)]] {
        let memory = Memory { stuck: Some("part"), ..Memory::default() };
        let json = Record::new(&key(), objects).to_json().expect("serialises");
        memory.files.lock().expect("sound").insert(key().hex(), json);
        let error = get(&shared(memory)).expect_err("refused");
        assert!(error.contains("is no record of this program"), "{error}");
    }
}

#[test]
fn of_an_outage_the_first_failure_is_told() {
    let shared = shared(Memory { failing: 3.into(), ..Memory::default() });
    let failures = (0..3).filter(|_| {
        let told = get(&shared).is_err();
        let at = Instant::now() - PAUSES[1];
        assert!(matches!(shared.state(), State::Failed(_, pause) if pause <= PAUSES[1]));
        shared.set_state(State::Failed(at, PAUSES[0]));
        told
    });
    assert_eq!(failures.count(), 1);
    assert_eq!(get(&shared), Ok(None));
    assert_eq!((shared.state(), shared.tally.failures.load(Relaxed)), (State::On, 3));
}

#[test]
fn pauses_grow_to_a_limit() {
    let shared = shared(Memory::default());
    let mut pauses = Vec::new();
    for _ in 0..6 {
        pauses.push(shared.next_pause().as_secs());
        shared.set_state(State::Failed(Instant::now(), shared.next_pause()));
    }
    assert_eq!(pauses, [60, 120, 240, 480, 960, 960]);
}

#[test]
fn a_tier_that_may_not_be_written_is_read_on() {
    let memory = Arc::new(Memory { denied: Some("put_object"), ..Memory::default() });
    let other = shared(Memory::default());
    put(&other).expect("stores");
    let shared = Shared::new("server", Ok(memory), false, Trust::default()).with_patience(PATIENCE);
    let told = put(&shared).expect_err("denied");
    assert!(told.contains("is read, but not written: no right"), "{told}");
    assert_eq!((put(&shared), get(&shared)), (Ok(()), Ok(None)));
    assert_eq!(shared.state(), State::On);
}

#[test]
fn a_probe_tells_what_a_tier_is_good_for() {
    let probe = |memory| Arc::new(shared(memory)).probe().map_err(|e| e.to_string());
    assert_eq!(probe(Memory::default()), Ok(()));
    let read_only = probe(Memory { denied: Some("put_object"), ..Memory::default() }).expect_err("read-only");
    assert!(read_only.contains("is read, but not written"), "{read_only}");
    let denied = probe(Memory { denied: Some("probe"), ..Memory::default() }).expect_err("denied");
    assert!(denied.contains("cannot be used: probe; mend the address"), "{denied}");
    let unknown = Arc::new(Shared::new("s3://x", Err("no such scheme".into()), false, Trust::default()));
    assert!(matches!(unknown.probe(), Err(StorageError::Misconfigured { .. })));
}

#[test]
fn damage_is_replaced_by_the_next_result() {
    let memory = Arc::new(Memory::default());
    let shared = Shared::new("server", Ok(memory.clone()), false, Trust::default()).with_patience(PATIENCE);
    put(&shared).expect("stores");
    let hash = content_hash(b"content").to_string();
    memory.files.lock().expect("sound").insert(hash, b"CONTENT".to_vec());
    assert!(get(&shared).is_err_and(|told| told.contains("does not match its hash")));
    assert_eq!((get(&shared).is_err(), shared.state()), (true, State::On));
    put(&shared).expect("stores");
    assert_eq!(get(&shared), Ok(Some(entry())));
}

#[test]
fn results_without_a_trusted_signature_are_misses_until_they_are_signed() {
    let memory = Arc::new(Memory::default());
    let machine = |trust| Shared::new("server", Ok(memory.clone()), false, trust).with_patience(PATIENCE);
    let secret = SecretKey::from_bytes(&[1; 32]);
    put(&machine(Trust::default())).expect("stores");
    let build = machine(Trust { trusted: vec![secret.public()], signer: Some(secret.clone()) });
    assert!(get(&build).is_err_and(|told| told.contains("without a valid signature")));
    assert_eq!((get(&build), build.tally.untrusted.load(Relaxed)), (Ok(None), 2));
    put(&build).expect("replaces");
    let artist = machine(Trust { trusted: vec![secret.public()], signer: None });
    assert_eq!(get(&artist), Ok(Some(entry())));
}
