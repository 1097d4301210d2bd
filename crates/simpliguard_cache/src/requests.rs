//! Requests to a shared tier, each with a time limit.
//!
//! A call to a file system or to a library cannot be ended from outside. So each request runs on a thread of its own,
//! and the caller stops waiting for it. A thread that never comes back holds no lock.

use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use simpliguard_key::{Key, content_hash};

use crate::counters::{Tally, add};
use crate::record::{Entry, MOST_RECORD_BYTES, ObjectRecord, Record};
use crate::shared::Pulse;
use crate::signature::Trust;
use crate::tier::{Damaged, Fault, There, Tier};

/// Most bytes that one request reads.
const PART: u64 = 4 << 20;
/// Time between two looks at the caller's cancellation.
pub(crate) const LOOK: Duration = Duration::from_millis(50);
/// Time that a tier has for its answers before the result is made here meanwhile.
pub(crate) const HEAD_START: Duration = Duration::from_millis(700);

/// The time that a request may take.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patience {
    /// For an answer.
    pub(crate) request: Duration,
    /// Slowest transfer that is waited for.
    pub(crate) bytes_per_second: u64,
}

impl Default for Patience {
    fn default() -> Self {
        // A file server that wakes its disks needs 10 seconds.
        Self { request: Duration::from_secs(20), bytes_per_second: 256 << 10 }
    }
}

impl Patience {
    /// The time that a transfer may take.
    fn for_bytes(self, bytes: u64) -> Duration {
        Duration::from_secs(bytes / self.bytes_per_second)
    }
}

/// The end of a request without an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Failure {
    /// The tier answered with an error, for this reason.
    Broken(String),
    /// The rights do not suffice, for this reason.
    Denied(String),
    /// There is no such place, for this reason.
    NoPlace(String),
    /// A file of the tier is damaged; the tier itself works.
    Damaged(String),
    /// The tier did not answer for this time.
    Stalled(Duration),
    /// The caller does not want an answer any more.
    Cancelled,
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Denied(reason) => Self::Denied(reason),
            Fault::NoPlace(reason) => Self::NoPlace(reason),
            Fault::Failed(reason) => Self::Broken(reason),
        }
    }
}

/// The answer to a question for a record.
pub(crate) enum Found<T> {
    /// There is none, or one of another version of this program.
    Nothing,
    /// There is one without a valid signature of a trusted key.
    Untrusted,
    Something(T),
}

/// Sends requests to a tier.
#[derive(Clone, Copy)]
pub(crate) struct Requests<'a> {
    pub(crate) tier: &'a Arc<dyn Tier>,
    pub(crate) patience: Patience,
    pub(crate) pulse: &'a Pulse,
    pub(crate) trust: &'a Trust,
    pub(crate) tally: &'a Tally,
    /// Told of files that a later result has to replace.
    pub(crate) replace: &'a dyn Fn(Damaged),
    pub(crate) is_cancelled: &'a dyn Fn() -> bool,
}

impl Requests<'_> {
    /// Asks whether the tier can be used.
    pub(crate) fn probe(self, write: bool) -> Result<(), Failure> {
        self.send(0, move |tier| tier.probe(write))
    }

    /// The result of a key, checked against its hashes.
    pub(crate) fn get(self, key: &Key) -> Result<Found<Entry>, Failure> {
        let record = match self.record(key)? {
            Found::Something(record) => record,
            Found::Untrusted => return Ok(Found::Untrusted),
            Found::Nothing => return Ok(Found::Nothing),
        };
        let mut objects = Vec::with_capacity(record.objects.len());
        for object in record.objects {
            let Some(bytes) = self.object(&object)? else { return Ok(Found::Nothing) };
            objects.push((object.name, bytes));
        }
        Ok(Found::Something(Entry { objects }))
    }

    /// Tells whether the result of a key is there with all its objects. Their contents are not read.
    pub(crate) fn has(self, key: &Key) -> Result<Found<()>, Failure> {
        let record = match self.record(key)? {
            Found::Something(record) => record,
            Found::Untrusted => return Ok(Found::Untrusted),
            Found::Nothing => return Ok(Found::Nothing),
        };
        for ObjectRecord { hash, size, .. } in record.objects {
            if !self.send(0, move |tier| tier.has_object(&hash, size))? {
                return Ok(Found::Nothing);
            }
        }
        Ok(Found::Something(()))
    }

    /// The record of a key.
    fn record(self, key: &Key) -> Result<Found<Record>, Failure> {
        let key = *key;
        let Some(json) = self.send(0, move |tier| tier.record(&key, MOST_RECORD_BYTES))? else {
            return Ok(Found::Nothing);
        };
        add(&self.tally.bytes_read, json.len() as u64);
        match Record::parse(&json, &key.hex()) {
            Ok(Some(record)) if self.trust.accepts(&record) => Ok(Found::Something(record)),
            Ok(record) => {
                (self.replace)(Damaged::Record(key));
                Ok(if record.is_some() { Found::Untrusted } else { Found::Nothing })
            }
            Err(reason) => Err(self.damaged(Damaged::Record(key), &reason)),
        }
    }

    fn object(self, object: &ObjectRecord) -> Result<Option<Vec<u8>>, Failure> {
        let (hash, size) = (object.hash, object.size);
        // Memory is taken part by part: the size is a claim until the bytes are there.
        let mut bytes = Vec::new();
        while (bytes.len() as u64) < size {
            let start = bytes.len() as u64;
            let part = start..size.min(start + PART);
            let wanted = part.end - part.start;
            let Some(found) = self.send(wanted, move |tier| tier.part(&hash, part))? else { return Ok(None) };
            add(&self.tally.bytes_read, found.len() as u64);
            bytes.extend_from_slice(&found);
            if found.len() as u64 != wanted {
                break;
            }
        }
        let reason = if bytes.len() as u64 != size {
            format!("has {} bytes instead of {size}", bytes.len())
        } else if content_hash(&bytes) != hash {
            "does not match its hash".to_owned()
        } else {
            return Ok(Some(bytes));
        };
        Err(self.damaged(Damaged::Object(hash), &reason))
    }

    /// Stores a result: first its objects, then the record that lists them. `there` tells what may be in their way.
    pub(crate) fn put(self, key: &Key, entry: Entry, there: impl Fn(Damaged) -> There) -> Result<(), Failure> {
        let key = *key;
        let mut objects = Vec::with_capacity(entry.objects.len());
        for (name, bytes) in entry.objects {
            let (hash, size) = (content_hash(&bytes), bytes.len() as u64);
            let there = there(Damaged::Object(hash));
            self.send(size, move |tier| tier.put_object(&hash, &bytes, there))?;
            add(&self.tally.bytes_written, size);
            objects.push(ObjectRecord { name, hash, size });
        }
        let json = self.trust.sign(Record::new(&key, objects)).to_json();
        let json = json.map_err(|e| Failure::Broken(e.to_string()))?;
        let (size, there) = (json.len() as u64, there(Damaged::Record(key)));
        self.send(size, move |tier| tier.put_record(&key, &json, there))?;
        add(&self.tally.bytes_written, size);
        Ok(())
    }

    /// Sets a damaged file aside, and has it replaced by the next result.
    pub(crate) fn damaged(self, damaged: Damaged, reason: &str) -> Failure {
        (self.replace)(damaged);
        let reason = reason.to_owned();
        match self.send(0, move |tier| Ok(tier.set_aside(damaged, &reason))) {
            Ok(description) => Failure::Damaged(description),
            Err(failure) => failure,
        }
    }

    /// Sends a request that moves about `bytes`, and waits for the answer.
    fn send<T: Send + 'static>(
        self,
        bytes: u64,
        request: impl FnOnce(&dyn Tier) -> Result<T, Fault> + Send + 'static,
    ) -> Result<T, Failure> {
        add(&self.tally.requests, 1);
        let (sender, answer) = mpsc::sync_channel(1);
        let tier = self.tier.clone();
        let work = move || drop(sender.send(request(tier.as_ref())));
        let thread = thread::Builder::new().name("simpliguard shared cache".into()).spawn(work);
        thread.map_err(|e| Failure::Broken(format!("cannot start a thread: {e}")))?;
        let transfer = self.patience.for_bytes(bytes);
        let (start, limit) = (Instant::now(), self.patience.request + transfer);
        let wait = self.pulse.wait(transfer);
        loop {
            match answer.recv_timeout(LOOK.min(limit)) {
                Ok(answer) => {
                    wait.answered();
                    return answer.map_err(Failure::from);
                }
                Err(RecvTimeoutError::Disconnected) => return Err(Failure::Broken("the request failed".into())),
                Err(RecvTimeoutError::Timeout) if (self.is_cancelled)() => return Err(Failure::Cancelled),
                Err(RecvTimeoutError::Timeout) if start.elapsed() >= limit => return Err(Failure::Stalled(limit)),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }
}
