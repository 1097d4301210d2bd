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
mod tests;
