//! The shared tier: results of other machines.
//!
//! A result that is missing here is fetched from the tier, checked and stored here. A result that is made here is
//! stored in the tier too. A tier that fails is left alone for a while, longer after each failure, and one that does not
//! answer in time for good. It never stops a bake.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::counters::{Tally, add};
use crate::error::StorageError;
use crate::flight::Flight;
use crate::record::Entry;
use crate::requests::{Failure, Found, Patience, Requests};
use crate::signature::Trust;
use crate::tier::{Damaged, There, Tier};

/// Time for which a tier that failed is left alone. It doubles with each failure, from the first value to the second.
const PAUSES: [Duration; 2] = [Duration::from_secs(60), Duration::from_secs(960)];

/// The willingness to ask a tier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    On,
    /// It failed at that time, and is left alone for this one.
    Failed(Instant, Duration),
    /// It did not answer in time, or is no place for results.
    Off,
}

/// A tier as a cache uses it.
#[derive(Debug)]
pub(crate) struct Shared {
    address: String,
    tier: Result<Arc<dyn Tier>, String>,
    /// Set if nothing may be stored, by the settings or by the rights.
    read_only: AtomicBool,
    patience: Patience,
    trust: Trust,
    tally: Tally,
    state: Mutex<State>,
    /// Files that were found damaged or may not be used, as [`name_of`] names them. Whoever bakes the result replaces them.
    replace: Mutex<BTreeSet<String>>,
    /// Set after the warning of untrusted results.
    has_warned: AtomicBool,
}

impl Shared {
    /// The tier at `address`, or the reason why it cannot be opened.
    pub(crate) fn new(address: &str, tier: Result<Arc<dyn Tier>, String>, read_only: bool, trust: Trust) -> Self {
        Self {
            address: address.to_owned(),
            tier,
            read_only: read_only.into(),
            patience: Patience::default(),
            trust,
            tally: Tally::default(),
            state: Mutex::default(),
            replace: Mutex::default(),
            has_warned: false.into(),
        }
    }

    #[cfg(test)]
    pub(crate) fn with_patience(self, patience: Patience) -> Self {
        Self { patience, ..self }
    }

    pub(crate) fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Tells whether results would be stored now.
    pub(crate) fn is_writable(&self) -> bool {
        !self.read_only.load(Relaxed) && self.is_on()
    }

    /// Asks the tier whether it can be read and, unless it is read-only, written.
    pub(crate) fn probe(&self) -> Result<(), StorageError> {
        let never = || false;
        self.ask("read from", &never, |requests| requests.probe(false))?;
        if self.is_writable() {
            self.ask("write to", &never, |requests| requests.probe(true))?;
        }
        Ok(())
    }

    /// The result that `flight` asks for: its objects match their hashes, its record is trusted, and it passes the check.
    pub(crate) fn get(&self, flight: &Flight<'_>) -> Result<Option<Entry>, StorageError> {
        let get = |requests: Requests<'_>| {
            let found = requests.get(flight.key)?;
            let Found::Something(entry) = &found else { return Ok(found) };
            let Err(reason) = (flight.check)(entry) else { return Ok(found) };
            Err(requests.damaged(Damaged::Record(*flight.key), &reason))
        };
        self.count(self.ask("read from", flight.is_cancelled, get))
    }

    /// Tells whether the tier has the result that `flight` asks for, with all its objects. Nothing is fetched.
    pub(crate) fn has(&self, flight: &Flight<'_>) -> Result<bool, StorageError> {
        let has = |requests: Requests<'_>| requests.has(flight.key);
        Ok(self.count(self.ask("read from", flight.is_cancelled, has))?.is_some())
    }

    /// Counts an answer. The first untrusted one is an error.
    fn count<T>(&self, answer: Result<Option<Found<T>>, StorageError>) -> Result<Option<T>, StorageError> {
        if let Ok(Some(Found::Something(found))) = answer {
            add(&self.tally.hits, 1);
            return Ok(Some(found));
        }
        add(&self.tally.misses, 1);
        if matches!(answer?, Some(Found::Untrusted)) {
            add(&self.tally.untrusted, 1);
            if !self.has_warned.swap(true, Relaxed) {
                return Err(StorageError::Untrusted { address: self.address.clone() });
            }
        }
        Ok(None)
    }

    /// Stores the result that `flight` asks for.
    pub(crate) fn put(&self, flight: &Flight<'_>, entry: Entry) -> Result<(), StorageError> {
        if !self.is_writable() {
            return Ok(());
        }
        let there = |file| if self.to_replace().remove(&name_of(file)) { There::Bad } else { There::Equal };
        let put = |requests: Requests<'_>| requests.put(flight.key, entry, there);
        if self.ask("write to", flight.is_cancelled, put)?.is_some() {
            add(&self.tally.stored, 1);
        }
        Ok(())
    }

    fn to_replace(&self) -> std::sync::MutexGuard<'_, BTreeSet<String>> {
        self.replace.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `operation` with the tier. `None` while the tier is left alone, and if the caller is cancelled. Of the failures of
    /// one outage, the first is an error.
    fn ask<T>(
        &self,
        action: &'static str,
        is_cancelled: &dyn Fn() -> bool,
        operation: impl FnOnce(Requests<'_>) -> Result<T, Failure>,
    ) -> Result<Option<T>, StorageError> {
        if !self.is_on() {
            return Ok(None);
        }
        let replace = |file| {
            self.to_replace().insert(name_of(file));
        };
        let (patience, trust, tally) = (self.patience, &self.trust, &self.tally);
        let requests = |tier| Requests { tier, patience, trust, tally, replace: &replace, is_cancelled };
        let answer = self.tier.as_ref().map_err(|reason| Failure::NoPlace(reason.clone())).map(requests);
        match answer.and_then(operation) {
            Ok(done) => {
                self.set_state(State::On);
                Ok(Some(done))
            }
            Err(Failure::Cancelled) => Ok(None),
            Err(failure) => self.failed(action, failure).map_or(Ok(None), Err),
        }
    }

    /// Notes a failure. Returns the error to tell of, if nobody was told of this outage yet.
    fn failed(&self, action: &'static str, failure: Failure) -> Option<StorageError> {
        let address = self.address.clone();
        if let Failure::Damaged(reason) = failure {
            add(&self.tally.damaged, 1);
            return Some(StorageError::Shared { action, address, reason });
        }
        add(&self.tally.failures, 1);
        let first = |next| matches!(self.set_state(next), State::On);
        match failure {
            Failure::Broken(reason) => {
                let is_first = first(State::Failed(Instant::now(), self.next_pause()));
                is_first.then_some(StorageError::Shared { action, address, reason })
            }
            Failure::Denied(reason) if action == "write to" => {
                (!self.read_only.swap(true, Relaxed)).then_some(StorageError::ReadOnly { address, reason })
            }
            Failure::Denied(reason) | Failure::NoPlace(reason) => {
                first(State::Off).then_some(StorageError::Misconfigured { address, reason })
            }
            // Of several threads that wait, one tells of it.
            Failure::Stalled(time) => {
                (self.set_state(State::Off) != State::Off).then_some(StorageError::Stalled { address, time })
            }
            Failure::Cancelled | Failure::Damaged(_) => None,
        }
    }

    fn state(&self) -> State {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_on(&self) -> bool {
        match self.state() {
            State::On => true,
            State::Failed(at, pause) => at.elapsed() >= pause,
            State::Off => false,
        }
    }

    fn next_pause(&self) -> Duration {
        match self.state() {
            State::Failed(_, pause) => (2 * pause).min(PAUSES[1]),
            State::On | State::Off => PAUSES[0],
        }
    }

    /// Returns the state before. A tier that is off stays so.
    fn set_state(&self, state: State) -> State {
        let mut current = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let before = *current;
        if before != State::Off {
            *current = state;
        }
        before
    }
}

/// A name for a file of a tier.
fn name_of(file: Damaged) -> String {
    match file {
        Damaged::Record(key) => format!("record {}", key.hex()),
        Damaged::Object(hash) => format!("object {}", hash.to_hex()),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::ops::Range;
    use std::sync::atomic::{AtomicU32, Ordering::SeqCst};
    use std::thread;

    use blake3::Hash;
    use simpliguard_key::{Key, KeyBuilder, content_hash};

    use super::*;
    use crate::record::{MOST_RECORD_BYTES, ObjectRecord, Record};
    use crate::signature::SecretKey;
    use crate::tier::Fault;

    const PATIENCE: Patience = Patience { request: Duration::from_millis(200), bytes_per_second: u64::MAX };

    /// Files in memory.
    #[derive(Debug, Default)]
    struct Memory {
        files: Mutex<BTreeMap<String, Vec<u8>>>,
        /// The request that never returns.
        stuck: Option<&'static str>,
        /// The request that is denied.
        denied: Option<&'static str>,
        /// The number of requests that fail before the others are answered.
        failing: AtomicU32,
    }

    impl Memory {
        fn answer<T>(&self, request: &str, answer: impl FnOnce(&mut BTreeMap<String, Vec<u8>>) -> T) -> T {
            if self.stuck == Some(request) {
                thread::sleep(Duration::from_secs(3600));
            }
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
        Entry {
            objects: vec![("a".into(), b"content".to_vec()), ("empty".into(), vec![]), ("b".into(), vec![7; 9 << 20])],
        }
    }

    fn shared(tier: Memory) -> Shared {
        Shared::new("server", Ok(Arc::new(tier)), false, Trust::default()).with_patience(PATIENCE)
    }

    fn get(shared: &Shared) -> Result<Option<Entry>, String> {
        shared.get(&flight(&key())).map_err(|e| e.to_string())
    }

    fn put(shared: &Shared) -> Result<(), String> {
        shared.put(&flight(&key()), entry()).map_err(|e| e.to_string())
    }

    fn flight(key: &Key) -> Flight<'_> {
        Flight { key, is_cancelled: &|| false, notify: &|_| {}, check: &|_| Ok(()) }
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
                [
                    "shared cache: server has not answered for 0.2 seconds and is not asked again in this run; results stay \
                  on this machine: check the connection"
                ]
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
        assert_eq!(shared.get(&flight).expect("no warning"), None);
        assert!(start.elapsed() < Duration::from_secs(5));
    }

    #[test]
    fn what_the_caller_refuses_is_not_found() {
        let shared = shared(Memory::default());
        put(&shared).expect("stores");
        let key = key();
        let flight = Flight { check: &|_| Err("is no model".into()), ..flight(&key) };
        let error = shared.get(&flight).expect_err("refused");
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
        let probe = |memory| shared(memory).probe().map_err(|e| e.to_string());
        assert_eq!(probe(Memory::default()), Ok(()));
        let read_only = probe(Memory { denied: Some("put_object"), ..Memory::default() }).expect_err("read-only");
        assert!(read_only.contains("is read, but not written"), "{read_only}");
        let denied = probe(Memory { denied: Some("probe"), ..Memory::default() }).expect_err("denied");
        assert!(denied.contains("cannot be used: probe; mend the address"), "{denied}");
        let unknown = Shared::new("s3://x", Err("no such scheme".into()), false, Trust::default());
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
}
