//! The queue of bakes: at most one per model waits or is in flight, always the latest.
//!
//! The queue is bookkeeping only. No file is read, hashed or written under its lock, because the processor takes it.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bevy::asset::AssetPath;
use bevy::platform::collections::HashMap;
use bytes::Bytes;
use simpliguard::{Cancellation, Key};

use super::request::BakeRequest;

/// Time between two checks for a missing file.
const RECHECK: Duration = Duration::from_secs(1);

/// The destination of a result.
#[derive(Debug)]
pub(super) enum Goal {
    /// The place of the processed file. The hash is that of the bytes that the processor writes meanwhile.
    Swap(blake3::Hash),
    /// The processor, which waits for the result.
    Answer(async_channel::Sender<Bytes>),
}

/// A request and the destination of its result.
#[derive(Debug)]
pub(super) struct Job {
    pub(super) request: BakeRequest,
    pub(super) goal: Goal,
    /// Files that the model refers to and that were missing. If there are any, the job waits until one of them exists.
    pub(super) missing: Vec<AssetPath<'static>>,
}

impl Job {
    /// A job whose result is swapped in. The processor writes bytes with the hash `meanwhile` first.
    pub(super) fn swapped_in(request: BakeRequest, meanwhile: blake3::Hash) -> Self {
        Self { request, goal: Goal::Swap(meanwhile), missing: Vec::new() }
    }

    /// Like [`Self::swapped_in`], but waits until one of the missing files exists.
    pub(super) fn when_there(request: BakeRequest, meanwhile: blake3::Hash, missing: Vec<AssetPath<'static>>) -> Self {
        Self { missing, ..Self::swapped_in(request, meanwhile) }
    }

    /// A job that the processor waits for. The receiver gets the result; it is closed if there is none.
    pub(super) fn awaited(request: BakeRequest) -> (Self, async_channel::Receiver<Bytes>) {
        let (sender, receiver) = async_channel::bounded(1);
        (Self { request, goal: Goal::Answer(sender), missing: Vec::new() }, receiver)
    }

    /// Tells whether the game shows something else until the result is there.
    pub(super) fn is_swapped_in(&self) -> bool {
        matches!(self.goal, Goal::Swap(_))
    }
}

/// A job that a worker has taken.
#[derive(Debug)]
pub(super) struct InFlight {
    pub(super) job: Job,
    /// Set when nobody needs the result any more.
    pub(super) cancellation: Cancellation,
    /// True if the result was swapped in.
    pub(super) is_delivered: bool,
}

/// The queue's record of a job in flight.
#[derive(Debug)]
struct Flight {
    path: AssetPath<'static>,
    key: Key,
    is_swapped_in: bool,
    cancellation: Cancellation,
}

/// The desired levels of a model whose processed file is to be swapped.
#[derive(Debug)]
struct Desired {
    key: Key,
    /// The hash of the processed file as the processor, or the last swap, has left it.
    file: blake3::Hash,
    /// True if the result is in place.
    is_met: bool,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<Job>,
    /// Jobs that wait for missing files, and the time of the next check.
    postponed: Vec<(Instant, Job)>,
    in_flight: Vec<Flight>,
    desired: HashMap<AssetPath<'static>, Desired>,
    is_closed: bool,
}

/// The queue. The processor adds jobs, and the workers take them.
#[derive(Debug, Default)]
pub(super) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
}

impl Queue {
    /// Adds a job. It replaces older jobs of its model. If the same bake is in flight, that one delivers the result.
    pub(super) fn push(&self, job: Job) {
        let mut state = self.lock();
        if state.is_closed {
            return;
        }
        let (path, key) = (job.request.path.clone(), job.request.key);
        state.drop_waiting(&path);
        state.cancel_in_flight(&path, Some(key));
        match job.goal {
            Goal::Swap(file) => {
                state.desired.insert(path.clone(), Desired { key, file, is_met: false });
                if job.missing.is_empty() && state.will_swap_in(&path, key) {
                    return;
                }
            }
            Goal::Answer(_) => {
                state.desired.remove(&path);
            }
        }
        state.waiting.push_back(job);
        self.changed.notify_all();
    }

    /// Drops and cancels all bakes of a model. Returns the key of the levels that were desired and are not in place yet.
    pub(super) fn forget(&self, path: &AssetPath<'static>) -> Option<Key> {
        let mut state = self.lock();
        state.drop_waiting(path);
        state.cancel_in_flight(path, None);
        state.desired.remove(path).filter(|desired| !desired.is_met).map(|desired| desired.key)
    }

    /// Takes a job; waits until there is one. `None` once the queue is closed. Jobs with the key of one in flight stay:
    /// they will find its result in the cache.
    pub(super) fn take(&self) -> Option<InFlight> {
        let mut state = self.lock();
        loop {
            if state.is_closed {
                return None;
            }
            if let Some(job) = state.next_job() {
                return Some(state.begin(job));
            }
            let pause = state.recall(Instant::now());
            if pause.is_some_and(|pause| pause.is_zero()) {
                continue;
            }
            state = match pause {
                None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(pause) => self.changed.wait_timeout(state, pause).unwrap_or_else(PoisonError::into_inner).0,
            };
        }
    }

    /// Ends a job that was taken, whatever its outcome. A job with missing files comes back later, unless there is
    /// another one for its model.
    pub(super) fn release(&self, ended: InFlight) {
        let mut state = self.lock();
        let request = &ended.job.request;
        state.in_flight.retain(|flight| flight.key != request.key || flight.path != request.path);
        let desired = state.desired.get(&request.path).filter(|desired| desired.key == request.key);
        let (is_desired, is_met) = (desired.is_some(), desired.is_some_and(|desired| desired.is_met));
        if is_desired && !ended.job.missing.is_empty() {
            state.postponed.push((Instant::now() + RECHECK, ended.job));
        } else if is_desired && !is_met && ended.is_delivered {
            // The processor has written the model once more after the swap.
            state.waiting.push_back(ended.job);
        }
        self.changed.notify_all();
    }

    /// Gives a job in flight another key: a missing file exists now, although Bevy had no reason to process the model
    /// again. `false` if there is another job for the model.
    pub(super) fn rekey(&self, in_flight: &mut InFlight, key: Key) -> bool {
        let mut state = self.lock();
        let request = &mut in_flight.job.request;
        let Some(desired) = state.desired.get_mut(&request.path).filter(|desired| desired.key == request.key) else {
            return false;
        };
        desired.key = key;
        let flights = state.in_flight.iter_mut();
        flights.filter(|flight| flight.path == request.path && flight.key == request.key).for_each(|f| f.key = key);
        request.key = key;
        true
    }

    /// Closes the queue: drops all waiting jobs and cancels those in flight.
    pub(super) fn close(&self) {
        let mut state = self.lock();
        state.is_closed = true;
        state.waiting.clear();
        state.postponed.clear();
        state.desired.clear();
        for flight in &state.in_flight {
            flight.cancellation.cancel();
        }
        self.changed.notify_all();
    }

    /// The hash that the processed file of a request must have to be swapped. `None` if the request is not the desired
    /// one any more.
    pub(super) fn swappable(&self, request: &BakeRequest) -> Option<blake3::Hash> {
        let state = self.lock();
        state.desired.get(&request.path).filter(|desired| desired.key == request.key).map(|desired| desired.file)
    }

    /// Records a swap: the processed file has the hash `file` now. `is_result` tells the result from a preview.
    pub(super) fn swapped(&self, request: &BakeRequest, file: blake3::Hash, is_result: bool) {
        let mut state = self.lock();
        if let Some(desired) = state.desired.get_mut(&request.path).filter(|desired| desired.key == request.key) {
            desired.file = file;
            desired.is_met |= is_result;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The first waiting job whose key is not in flight.
    fn next_job(&mut self) -> Option<Job> {
        let is_free = |job: &Job| self.in_flight.iter().all(|flight| flight.key != job.request.key);
        let at = self.waiting.iter().position(is_free)?;
        self.waiting.remove(at)
    }

    fn begin(&mut self, job: Job) -> InFlight {
        let cancellation = Cancellation::default();
        let (path, key, is_swapped_in) = (job.request.path.clone(), job.request.key, job.is_swapped_in());
        self.in_flight.push(Flight { path, key, is_swapped_in, cancellation: cancellation.clone() });
        InFlight { job, cancellation, is_delivered: false }
    }

    /// Tells whether a bake in flight will swap in the result of this key.
    fn will_swap_in(&self, path: &AssetPath<'static>, key: Key) -> bool {
        let is_same = |flight: &&Flight| flight.path == *path && flight.key == key && flight.is_swapped_in;
        self.in_flight.iter().find(is_same).is_some_and(|flight| !flight.cancellation.is_cancelled())
    }

    fn drop_waiting(&mut self, path: &AssetPath<'static>) {
        self.waiting.retain(|job| job.request.path != *path);
        self.postponed.retain(|(_, job)| job.request.path != *path);
    }

    /// Moves postponed jobs whose time has come to the waiting ones. Returns the time until the next check: zero if
    /// jobs were moved, `None` if no job is postponed.
    fn recall(&mut self, now: Instant) -> Option<Duration> {
        let due = self.postponed.extract_if(.., |(time, _)| *time <= now).map(|(_, job)| job);
        let before = self.waiting.len();
        self.waiting.extend(due);
        if self.waiting.len() > before {
            return Some(Duration::ZERO);
        }
        self.postponed.iter().map(|(time, _)| *time - now).min()
    }

    /// Cancels the bakes of a model, except one with this key.
    fn cancel_in_flight(&mut self, path: &AssetPath<'static>, except: Option<Key>) {
        for flight in self.in_flight.iter().filter(|flight| flight.path == *path && Some(flight.key) != except) {
            flight.cancellation.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use simpliguard::KeyBuilder;
    use simpliguard::settings::BakeSettings;

    use super::*;

    fn request(path: &'static str, version: &str) -> BakeRequest {
        let key = KeyBuilder::new(version).finish();
        BakeRequest { path: path.into(), settings: BakeSettings::default(), key, image_key: key, cache: None }
    }

    fn job(path: &'static str, version: &str) -> Job {
        Job::swapped_in(request(path, version), blake3::hash(b"source"))
    }

    /// Records that the result of a job was swapped in.
    fn swap_in(queue: &Queue, in_flight: &mut InFlight) {
        queue.swapped(&in_flight.job.request, blake3::hash(b"levels"), true);
        in_flight.is_delivered = true;
    }

    #[test]
    fn the_latest_job_of_a_model_replaces_the_others() {
        let queue = Queue::default();
        queue.push(job("a.glb", "1"));
        let first = queue.take().expect("a job");
        for version in ["2", "3"] {
            queue.push(job("a.glb", version));
        }
        assert!(first.cancellation.is_cancelled());
        queue.release(first);
        let latest = queue.take().expect("a job");
        assert_eq!(latest.job.request.key, request("a.glb", "3").key);
        assert!(!latest.cancellation.is_cancelled() && queue.lock().waiting.is_empty());
    }

    #[test]
    fn a_model_that_is_processed_again_unchanged_is_not_baked_again() {
        let queue = Queue::default();
        queue.push(job("a.glb", "1"));
        let mut in_flight = queue.take().expect("a job");
        queue.push(job("a.glb", "1"));
        assert!(queue.lock().waiting.is_empty() && !in_flight.cancellation.is_cancelled());
        swap_in(&queue, &mut in_flight);
        assert_eq!(queue.swappable(&in_flight.job.request), Some(blake3::hash(b"levels")));
        // The processor writes the model over the levels before the worker has ended.
        queue.push(job("a.glb", "1"));
        assert_eq!(queue.swappable(&in_flight.job.request), Some(blake3::hash(b"source")));
        queue.release(in_flight);
        let mut again = queue.take().expect("a job");
        swap_in(&queue, &mut again);
        queue.release(again);
        assert!(queue.lock().waiting.is_empty());
    }

    #[test]
    fn equal_models_are_baked_one_after_another() {
        let queue = Queue::default();
        queue.push(job("a.glb", "1"));
        queue.push(job("b.glb", "1"));
        queue.push(job("c.glb", "2"));
        let a = queue.take().expect("a job");
        let c = queue.take().expect("a job");
        assert_eq!((a.job.request.path.to_string(), c.job.request.path.to_string()), ("a.glb".into(), "c.glb".into()));
        queue.release(a);
        assert_eq!(queue.take().expect("a job").job.request.path, "b.glb".into());
    }

    #[test]
    fn only_the_desired_request_may_be_swapped() {
        let queue = Queue::default();
        queue.push(job("a.glb", "1"));
        let in_flight = queue.take().expect("a job");
        let first = in_flight.job.request.clone();
        assert_eq!(queue.swappable(&first), Some(blake3::hash(b"source")));
        queue.swapped(&first, blake3::hash(b"preview"), false);
        assert!(!queue.lock().desired[&first.path].is_met, "the result is still to come");
        queue.push(job("a.glb", "2"));
        assert_eq!(queue.swappable(&first), None);
        // An outdated swap changes nothing.
        queue.swapped(&first, blake3::hash(b"levels"), true);
        assert_eq!(queue.swappable(&request("a.glb", "2")), Some(blake3::hash(b"source")));
        assert!(!queue.lock().desired[&first.path].is_met);
        queue.forget(&first.path);
        assert_eq!(queue.swappable(&request("a.glb", "2")), None);
    }

    #[test]
    fn what_is_forgotten_is_still_to_come_until_the_result_is_in_place() {
        let (queue, path) = (Queue::default(), AssetPath::from("a.glb"));
        queue.push(job("a.glb", "1"));
        let mut in_flight = queue.take().expect("a job");
        assert_eq!(queue.forget(&path), Some(in_flight.job.request.key));
        assert_eq!(queue.forget(&path), None);
        queue.release(in_flight);
        queue.push(job("a.glb", "1"));
        in_flight = queue.take().expect("a job");
        swap_in(&queue, &mut in_flight);
        assert_eq!(queue.forget(&path), None);
    }

    #[test]
    fn a_job_with_missing_files_comes_back_with_another_key() {
        let queue = Queue::default();
        let missing = vec![AssetPath::from("a.bin")];
        queue.push(Job::when_there(request("a.glb", "1"), blake3::hash(b"source"), missing));
        let mut in_flight = queue.take().expect("a job");
        let key = request("a.glb", "2").key;
        assert!(queue.rekey(&mut in_flight, key) && in_flight.job.request.key == key);
        queue.release(in_flight);
        assert_eq!(queue.lock().postponed.len(), 1);
        let mut in_flight = queue.take().expect("after a while");
        queue.push(job("a.glb", "3"));
        assert!(!queue.rekey(&mut in_flight, request("a.glb", "4").key));
        queue.release(in_flight);
        assert!(queue.lock().postponed.is_empty());
    }

    #[test]
    fn a_closed_queue_closes_what_is_awaited() {
        let queue = Queue::default();
        let (awaited, answer) = Job::awaited(request("b.glb", "1"));
        queue.push(awaited);
        queue.close();
        assert!(answer.recv_blocking().is_err() && queue.take().is_none());
    }
}
