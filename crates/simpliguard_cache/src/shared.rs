//! The shared tier: results of other machines.
//!
//! A result that is missing here is fetched from the tier, checked and stored here. A result that is made here is
//! stored in the tier too. A tier that fails is left alone for a while, and one that does not answer in time for good.
//! It never stops a bake.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::error::StorageError;
use crate::flight::Flight;
use crate::record::Entry;
use crate::requests::{Failure, Patience, Requests};
use crate::tier::{Damaged, Tier};

/// Time for which a tier that failed is left alone.
const PAUSE: Duration = Duration::from_secs(60);

/// The willingness to ask a tier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    On,
    /// It failed then.
    Failed(Instant),
    /// It did not answer in time.
    Off,
}

/// A tier as a cache uses it.
#[derive(Debug)]
pub(crate) struct Shared {
    address: String,
    tier: Result<Arc<dyn Tier>, String>,
    read_only: bool,
    patience: Patience,
    state: Mutex<State>,
}

impl Shared {
    /// The tier at `address`, or the reason why it cannot be opened.
    pub(crate) fn new(address: &str, tier: Result<Arc<dyn Tier>, String>, read_only: bool) -> Self {
        Self { address: address.to_owned(), tier, read_only, patience: Patience::default(), state: Mutex::default() }
    }

    #[cfg(test)]
    pub(crate) fn with_patience(self, patience: Patience) -> Self {
        Self { patience, ..self }
    }

    /// The result that `flight` asks for: its objects match their hashes and pass the check.
    pub(crate) fn get(&self, flight: &Flight<'_>) -> Result<Option<Entry>, StorageError> {
        let get = |requests: Requests<'_>| {
            let Some(entry) = requests.get(flight.key)? else { return Ok(None) };
            let Err(reason) = (flight.check)(&entry) else { return Ok(Some(entry)) };
            Err(Failure::Broken(requests.set_aside(Damaged::Record(*flight.key), &reason)?))
        };
        Ok(self.ask("read from", flight.is_cancelled, get)?.flatten())
    }

    /// Tells whether the tier has the result that `flight` asks for, with all its objects. Nothing is fetched.
    pub(crate) fn has(&self, flight: &Flight<'_>) -> Result<bool, StorageError> {
        let has = |requests: Requests<'_>| requests.has(flight.key);
        Ok(self.ask("read from", flight.is_cancelled, has)?.unwrap_or(false))
    }

    /// Stores the result that `flight` asks for.
    pub(crate) fn put(&self, flight: &Flight<'_>, entry: Entry) -> Result<(), StorageError> {
        if self.read_only {
            return Ok(());
        }
        self.ask("write to", flight.is_cancelled, |requests| requests.put(flight.key, entry)).map(drop)
    }

    /// Calls `operation` with the tier. `None` while the tier is left alone, and if the caller is cancelled.
    fn ask<T>(
        &self,
        action: &'static str,
        is_cancelled: &dyn Fn() -> bool,
        operation: impl FnOnce(Requests<'_>) -> Result<T, Failure>,
    ) -> Result<Option<T>, StorageError> {
        if !self.is_on() {
            return Ok(None);
        }
        let patience = self.patience;
        let requests = |tier| Requests { tier, patience, is_cancelled };
        let answer = self.tier.as_ref().map_err(|reason| Failure::Broken(reason.clone())).map(requests);
        match answer.and_then(operation) {
            Ok(done) => Ok(Some(done)),
            Err(Failure::Cancelled) => Ok(None),
            Err(Failure::Broken(reason)) => {
                self.set_state(State::Failed(Instant::now()));
                Err(StorageError::Shared { action, address: self.address.clone(), reason })
            }
            // Of several threads that wait, one tells of it.
            Err(Failure::Stalled(_)) if self.set_state(State::Off) == State::Off => Ok(None),
            Err(Failure::Stalled(time)) => Err(StorageError::Stalled { address: self.address.clone(), time }),
        }
    }

    fn is_on(&self) -> bool {
        match *self.state.lock().unwrap_or_else(PoisonError::into_inner) {
            State::On => true,
            State::Failed(at) => at.elapsed() >= PAUSE,
            State::Off => false,
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::ops::Range;
    use std::thread;

    use blake3::Hash;
    use simpliguard_key::{Key, KeyBuilder, content_hash};

    use super::*;
    use crate::record::{MOST_RECORD_BYTES, ObjectRecord, Record};

    const PATIENCE: Patience = Patience { request: Duration::from_millis(200), bytes_per_second: u64::MAX };

    /// Files in memory.
    #[derive(Debug, Default)]
    struct Memory {
        files: Mutex<BTreeMap<String, Vec<u8>>>,
        /// The request that never returns.
        stuck: Option<&'static str>,
    }

    impl Memory {
        fn answer<T>(&self, request: &str, answer: impl FnOnce(&mut BTreeMap<String, Vec<u8>>) -> T) -> T {
            if self.stuck == Some(request) {
                thread::sleep(Duration::from_secs(3600));
            }
            answer(&mut self.files.lock().expect("sound"))
        }
    }

    impl Tier for Memory {
        fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, String> {
            assert_eq!(most, MOST_RECORD_BYTES);
            self.answer("record", |files| Ok(files.get(&key.hex()).cloned()))
        }

        fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, String> {
            assert!(bytes.end - bytes.start <= 4 << 20, "a request for {bytes:?}");
            let part = |file: &Vec<u8>| file[bytes.start as usize..file.len().min(bytes.end as usize)].to_vec();
            self.answer("part", |files| Ok(files.get(object.to_hex().as_str()).map(part)))
        }

        fn has_object(&self, object: &Hash, size: u64) -> Result<bool, String> {
            let is_whole = |file: &Vec<u8>| file.len() as u64 == size;
            self.answer("has_object", |files| Ok(files.get(object.to_hex().as_str()).is_some_and(is_whole)))
        }

        fn put_object(&self, object: &Hash, bytes: &[u8]) -> Result<(), String> {
            self.answer("put_object", |files| files.insert(object.to_string(), bytes.to_vec()));
            Ok(())
        }

        fn put_record(&self, key: &Key, json: &[u8]) -> Result<(), String> {
            self.answer("put_record", |files| files.insert(key.hex(), json.to_vec()));
            Ok(())
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
        Shared::new("server", Ok(Arc::new(tier)), false).with_patience(PATIENCE)
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
        let shared = Shared::new("server", Ok(memory.clone()), false).with_patience(PATIENCE);
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
        let shared = Shared::new("server", Ok(Arc::new(Memory { stuck: Some("record"), ..Memory::default() })), false);
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
}
