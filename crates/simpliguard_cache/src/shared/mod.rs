//! The shared tier: results of other machines.
//!
//! A result that is missing here is fetched from the tier, checked and stored here. A result that is made here is
//! stored in the tier too. A tier that fails is left alone for a while, longer after each failure, and one that does not
//! answer in time for good. It never stops a bake.

mod pulse;

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use simpliguard_key::Key;

pub(crate) use self::pulse::Pulse;
use crate::counters::{Tally, add};
use crate::error::StorageError;
use crate::flight::{Check, Flight};
use crate::record::Entry;
use crate::requests::{Failure, Found, HEAD_START, Patience, Requests};
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
    pulse: Pulse,
    /// Failures of requests that nobody waited for.
    errors: Mutex<Vec<StorageError>>,
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
            pulse: Pulse::default(),
            errors: Mutex::default(),
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

    /// Tells whether the tier is asked now: it is neither left alone nor silent.
    pub(crate) fn is_answering(&self) -> bool {
        self.leave_if_silent();
        self.is_on()
    }

    /// Leaves the tier alone for a while if it has fallen silent. Of one outage, the first silence is noted.
    fn leave_if_silent(&self) {
        if let Some(time) = self.pulse.silence()
            && self.is_on()
            && matches!(self.set_state(State::Failed(Instant::now(), self.next_pause())), State::On)
        {
            self.note(StorageError::Silent { address: self.address.clone(), time });
        }
    }

    /// The longest time that a request has waited for an answer by now.
    pub(crate) fn longest_wait(&self) -> Duration {
        self.pulse.longest_wait()
    }

    /// Notes a failure for whoever asks next.
    pub(crate) fn note(&self, error: StorageError) {
        self.errors.lock().unwrap_or_else(PoisonError::into_inner).push(error);
    }

    /// The failures since the last call that nobody was told of.
    pub(crate) fn errors(&self) -> Vec<StorageError> {
        self.leave_if_silent();
        std::mem::take(&mut *self.errors.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Asks the tier whether it can be read and, unless it is read-only, written. If the tier does not answer soon, nobody waits
    /// for it, and what it says later is told later.
    pub(crate) fn probe(self: &Arc<Self>) -> Result<(), StorageError> {
        let (done, end) = mpsc::channel::<()>();
        let shared = self.clone();
        let work = move || {
            shared.probe_now().unwrap_or_else(|error| shared.note(error));
            drop(done);
        };
        let thread = thread::Builder::new().name("simpliguard probe".into()).spawn(work);
        if thread.is_ok() {
            let _ = end.recv_timeout(HEAD_START);
        }
        let error = self.errors.lock().unwrap_or_else(PoisonError::into_inner).pop();
        error.map_or(Ok(()), Err)
    }

    fn probe_now(&self) -> Result<(), StorageError> {
        let never = || false;
        self.ask("read from", &never, |requests| requests.probe(false))?;
        if self.is_writable() {
            self.ask("write to", &never, |requests| requests.probe(true))?;
        }
        Ok(())
    }

    /// The result of a key: its objects match their hashes, its record is trusted, it passes the check and has what the caller
    /// needs.
    pub(crate) fn get(&self, key: &Key, check: Check) -> Result<Option<Entry>, StorageError> {
        let get = |requests: Requests<'_>| {
            let found = requests.get(key)?;
            let Found::Something(entry) = &found else { return Ok(found) };
            match check(entry) {
                Ok(true) => Ok(found),
                Ok(false) => Ok(Found::Nothing),
                Err(reason) => Err(requests.damaged(Damaged::Record(*key), &reason)),
            }
        };
        self.count(self.ask("read from", &|| false, get))
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
        let (patience, pulse, trust, tally) = (self.patience, &self.pulse, &self.trust, &self.tally);
        let requests = |tier| Requests { tier, patience, pulse, trust, tally, replace: &replace, is_cancelled };
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
            // Of several threads that wait, one tells of it, unless its silence was told of.
            Failure::Stalled(time) => first(State::Off).then_some(StorageError::Stalled { address, time }),
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
mod tests;
