//! Bakes that wait and bakes that run: at most one per model, always the latest.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{fs, io, thread};

use bevy::asset::AssetPath;
use bevy::platform::collections::HashMap;
use bytes::Bytes;
use simpliguard::Cancellation;
use simpliguard_cache::{Durability, Key, write_atomic_through};

use super::activity::Activity;
use super::baker::Order;

/// Time between two looks for a missing file.
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// How long the processor may take to write the model that is to be exchanged.
const EXCHANGE_TRIES: u32 = 200;
const EXCHANGE_PAUSE: Duration = Duration::from_millis(50);

/// Where the result of a bake goes.
#[derive(Debug)]
enum Goal {
    /// Into the place of the processed file, as long as that has this hash.
    Exchange(blake3::Hash),
    /// To the processor, which waits for it.
    Answer(async_channel::Sender<Bytes>),
}

/// An order and where its result goes.
#[derive(Debug)]
pub(super) struct Job {
    pub(super) order: Order,
    goal: Goal,
    /// Files that the model refers to and that were not there. Nothing is to be done before one of them is.
    pub(super) missing: Vec<AssetPath<'static>>,
}

impl Job {
    /// The model was passed through; `passed` is the hash of its bytes.
    pub(super) fn in_background(order: Order, passed: blake3::Hash) -> Self {
        Self { order, goal: Goal::Exchange(passed), missing: Vec::new() }
    }

    /// As [`Self::in_background`], once one of the missing files is there.
    pub(super) fn once_there(order: Order, passed: blake3::Hash, missing: Vec<AssetPath<'static>>) -> Self {
        Self { order, goal: Goal::Exchange(passed), missing }
    }

    /// The receiver gets the result, or is closed if there is none.
    pub(super) fn awaited(order: Order) -> (Self, async_channel::Receiver<Bytes>) {
        let (sender, receiver) = async_channel::bounded(1);
        (Self { order, goal: Goal::Answer(sender), missing: Vec::new() }, receiver)
    }

    /// The game shows the model meanwhile.
    pub(super) fn is_in_background(&self) -> bool {
        matches!(self.goal, Goal::Exchange(_))
    }
}

/// A job that a worker has taken.
#[derive(Debug)]
pub(super) struct Taken {
    pub(super) job: Job,
    /// Set when the result is of no use any more.
    pub(super) cancellation: Cancellation,
    /// The result was brought where it belonged.
    delivered: bool,
}

/// Where a result belongs.
#[derive(Debug)]
pub(super) struct Place {
    /// The model's processed file.
    pub(super) file: PathBuf,
    /// A folder on its file system.
    pub(super) scratch: PathBuf,
    /// Who reads and writes it.
    pub(super) activity: Arc<Activity>,
}

/// What became of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Delivery {
    /// It is where it belongs, and was not before.
    Done,
    /// It was there before.
    WasThere,
    /// Nobody wants it any more.
    Superseded,
}

#[derive(Debug)]
struct Running {
    path: AssetPath<'static>,
    key: Key,
    exchanges: bool,
    cancellation: Cancellation,
}

/// The latest wish for a model whose processed file is to be exchanged.
#[derive(Debug)]
struct Wish {
    key: Key,
    passed: blake3::Hash,
    /// Its result is in place.
    met: bool,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<Job>,
    /// Jobs to look at again, and when.
    later: Vec<(Instant, Job)>,
    running: Vec<Running>,
    wishes: HashMap<AssetPath<'static>, Wish>,
    closed: bool,
}

/// Shared by the processor, which adds, and the workers, which take.
#[derive(Debug, Default)]
pub(super) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
}

impl Queue {
    /// Adds a job in place of older ones for the same model. One that runs already is left to it.
    pub(super) fn push(&self, job: Job) {
        let mut state = self.lock();
        if state.closed {
            return;
        }
        let (path, key) = (job.order.path.clone(), job.order.key);
        state.drop_waiting(&path);
        state.cancel_running(&path, Some(key));
        match job.goal {
            Goal::Exchange(passed) => {
                state.wishes.insert(path.clone(), Wish { key, passed, met: false });
                if job.missing.is_empty() && state.exchanges(&path, key) {
                    return;
                }
            }
            Goal::Answer(_) => {
                state.wishes.remove(&path);
            }
        }
        state.waiting.push_back(job);
        self.changed.notify_all();
    }

    /// Nothing is to be baked for a model.
    pub(super) fn forget(&self, path: &AssetPath<'static>) {
        let mut state = self.lock();
        state.drop_waiting(path);
        state.cancel_running(path, None);
        state.wishes.remove(path);
    }

    /// Takes a job, waiting for one; `None` once the queue is closed. Jobs with the key of a running one stay: they find
    /// its result in the cache.
    pub(super) fn take(&self) -> Option<Taken> {
        let mut state = self.lock();
        loop {
            if state.closed {
                return None;
            }
            let is_free = |job: &Job| state.running.iter().all(|r| r.key != job.order.key);
            if let Some(at) = state.waiting.iter().position(is_free)
                && let Some(job) = state.waiting.remove(at)
            {
                let cancellation = Cancellation::default();
                let (path, key) = (job.order.path.clone(), job.order.key);
                let exchanges = job.is_in_background();
                state.running.push(Running { path, key, exchanges, cancellation: cancellation.clone() });
                return Some(Taken { job, cancellation, delivered: false });
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

    /// A job that was taken has ended, however it went. If it misses files, it comes back later, unless there is another
    /// one for its model.
    pub(super) fn release(&self, taken: Taken) {
        let mut state = self.lock();
        let order = &taken.job.order;
        state.running.retain(|r| r.key != order.key || r.path != order.path);
        let wish = state.wishes.get(&order.path).filter(|wish| wish.key == order.key);
        let (wanted, met) = (wish.is_some(), wish.is_some_and(|wish| wish.met));
        if wanted && !taken.job.missing.is_empty() {
            state.later.push((Instant::now() + LOOK_AGAIN, taken.job));
        } else if wanted && !met && taken.delivered {
            // The processor has written the model once more since.
            state.waiting.push_back(taken.job);
        }
        self.changed.notify_all();
    }

    /// The model's files are not those of the order any more although Bevy has no reason to process it again: a missing
    /// one is there now. `false` if there is another job for the model.
    pub(super) fn rekey(&self, taken: &mut Taken, key: Key) -> bool {
        let mut state = self.lock();
        let order = &mut taken.job.order;
        let Some(wish) = state.wishes.get_mut(&order.path).filter(|wish| wish.key == order.key) else { return false };
        wish.key = key;
        for running in state.running.iter_mut().filter(|r| r.path == order.path && r.key == order.key) {
            running.key = key;
        }
        order.key = key;
        true
    }

    /// Ends all workers and gives up what waits.
    pub(super) fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        state.waiting.clear();
        state.later.clear();
        state.wishes.clear();
        for running in &state.running {
            running.cancellation.cancel();
        }
        self.changed.notify_all();
    }

    /// Brings a result where it belongs.
    pub(super) fn deliver(&self, taken: &mut Taken, glb: Bytes, place: &Place) -> io::Result<Delivery> {
        if let Goal::Answer(answer) = &taken.job.goal {
            let sent = answer.try_send(glb);
            return Ok(if sent.is_ok() { Delivery::Done } else { Delivery::Superseded });
        }
        for _ in 0..EXCHANGE_TRIES {
            match self.exchange(&taken.job.order, &glb, true, place)? {
                Some(Delivery::Superseded) => return Ok(Delivery::Superseded),
                Some(delivery) => {
                    taken.delivered = true;
                    return Ok(delivery);
                }
                // Bevy is still writing it.
                None => thread::sleep(EXCHANGE_PAUSE),
            }
        }
        Err(io::Error::other("something else has written the processed file"))
    }

    /// Puts levels in the model's place until the result is there. Returns whether they were.
    pub(super) fn show(&self, taken: &Taken, glb: &[u8], place: &Place) -> io::Result<bool> {
        Ok(self.exchange(&taken.job.order, glb, false, place)? == Some(Delivery::Done))
    }

    /// Exchanges a processed file that is as the processor, or the last exchange, has left it; `None` if it is not.
    fn exchange(&self, order: &Order, glb: &[u8], is_result: bool, place: &Place) -> io::Result<Option<Delivery>> {
        let Place { file, scratch, activity } = place;
        let ours = blake3::hash(glb);
        let mut state = self.lock();
        let Some(wish) = state.wishes.get_mut(&order.path).filter(|wish| wish.key == order.key) else {
            return Ok(Some(Delivery::Superseded));
        };
        // What the processor writes into a file that is exchanged meanwhile would be lost.
        let Some(_exchanging) = activity.exchanging(order.path.path(), Instant::now()) else { return Ok(None) };
        let there = fs::read(file).map(|bytes| blake3::hash(&bytes)).ok();
        let delivery = match there {
            Some(there) if there == ours => Delivery::WasThere,
            Some(there) if there == wish.passed => {
                write_atomic_through(scratch, file, glb, Durability::Process)?;
                wish.passed = ours;
                Delivery::Done
            }
            _ => return Ok(None),
        };
        wish.met |= is_result;
        Ok(Some(delivery))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Whether a worker is at a result and will put it in place.
    fn exchanges(&self, path: &AssetPath<'static>, key: Key) -> bool {
        let current = |r: &&Running| r.path == *path && r.key == key && r.exchanges;
        self.running.iter().find(current).is_some_and(|r| !r.cancellation.is_cancelled())
    }

    fn drop_waiting(&mut self, path: &AssetPath<'static>) {
        self.waiting.retain(|job| job.order.path != *path);
        self.later.retain(|(_, job)| job.order.path != *path);
    }

    /// Lets jobs wait for a worker whose time has come. Returns the time until there is something to do: none if there
    /// is already, `None` for ever.
    fn recall(&mut self, now: Instant) -> Option<Duration> {
        let due = self.later.extract_if(.., |(time, _)| *time <= now).map(|(_, job)| job);
        let before = self.waiting.len();
        self.waiting.extend(due);
        if self.waiting.len() > before {
            return Some(Duration::ZERO);
        }
        self.later.iter().map(|(time, _)| *time - now).min()
    }

    /// Cancels the bake of a model, unless it is of `key`.
    fn cancel_running(&mut self, path: &AssetPath<'static>, key: Option<Key>) {
        for running in self.running.iter().filter(|r| r.path == *path && Some(r.key) != key) {
            running.cancellation.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use simpliguard::settings::BakeSettings;
    use simpliguard_cache::KeyBuilder;

    use super::*;

    fn order(path: &'static str, version: &str) -> Order {
        let key = KeyBuilder::new(version).finish();
        Order { path: path.into(), settings: BakeSettings::default(), key, cache: None }
    }

    fn job(path: &'static str, version: &str) -> Job {
        Job::in_background(order(path, version), blake3::hash(b"source"))
    }

    /// A folder with a processed file.
    fn place(content: &str) -> (tempfile::TempDir, Place) {
        let dir = tempfile::tempdir().expect("tempdir");
        let file = dir.path().join("a.glb");
        fs::write(&file, content).expect("writes");
        let place = Place { file, scratch: dir.path().to_owned(), activity: Arc::default() };
        (dir, place)
    }

    /// A folder with a model that was passed through, and its job, taken.
    fn passed_through() -> (tempfile::TempDir, Place, Queue, Taken) {
        let (dir, place) = place("source");
        let queue = Queue::default();
        queue.push(job("a.glb", "1"));
        let taken = queue.take().expect("a job");
        (dir, place, queue, taken)
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
        assert_eq!(latest.job.order.key, order("a.glb", "3").key);
        assert!(!latest.cancellation.is_cancelled() && queue.lock().waiting.is_empty());
    }

    #[test]
    fn a_model_that_is_processed_again_unchanged_is_not_baked_again() {
        let (_dir, place, queue, mut taken) = passed_through();
        queue.push(job("a.glb", "1"));
        assert!(queue.lock().waiting.is_empty() && !taken.cancellation.is_cancelled());
        let levels = || Bytes::from_static(b"levels");
        let delivery = queue.deliver(&mut taken, levels(), &place);
        assert_eq!(delivery.expect("exchanges"), Delivery::Done);
        // The processor writes the model over the levels before the worker has ended.
        fs::write(&place.file, "source").expect("writes");
        queue.push(job("a.glb", "1"));
        queue.release(taken);
        let mut again = queue.take().expect("a job");
        assert_eq!(queue.deliver(&mut again, levels(), &place).expect("exchanges"), Delivery::Done);
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
        assert_eq!((a.job.order.path.to_string(), c.job.order.path.to_string()), ("a.glb".into(), "c.glb".into()));
        queue.release(a);
        assert_eq!(queue.take().expect("a job").job.order.path, "b.glb".into());
    }

    #[test]
    fn a_result_is_exchanged_only_for_what_was_passed_through() {
        let (_dir, place, queue, mut taken) = passed_through();
        let mut deliver = |bytes: &'static [u8]| queue.deliver(&mut taken, Bytes::from_static(bytes), &place);
        assert_eq!(deliver(b"levels").expect("exchanges"), Delivery::Done);
        assert_eq!(fs::read(&place.file).expect("reads"), b"levels");
        assert_eq!(deliver(b"levels").expect("is there"), Delivery::WasThere);
        queue.push(job("a.glb", "2"));
        assert_eq!(deliver(b"old levels").expect("no error"), Delivery::Superseded);
        queue.forget(&"a.glb".into());
        assert_eq!(deliver(b"old levels").expect("no error"), Delivery::Superseded);
        assert_eq!(fs::read(&place.file).expect("reads"), b"levels");
    }

    #[test]
    fn what_is_shown_gives_way_to_the_result() {
        let (_dir, place, queue, mut taken) = passed_through();
        assert!(queue.show(&taken, b"preview", &place).expect("exchanges"));
        assert_eq!(fs::read(&place.file).expect("reads"), b"preview");
        assert!(!queue.lock().wishes[&AssetPath::from("a.glb")].met, "the result is still to come");
        let delivery = queue.deliver(&mut taken, Bytes::from_static(b"levels"), &place);
        assert_eq!(delivery.expect("exchanges"), Delivery::Done);
        assert_eq!(fs::read(&place.file).expect("reads"), b"levels");
        // Nothing is shown of an outdated bake, nor while the processor writes.
        queue.push(job("a.glb", "2"));
        assert!(!queue.show(&taken, b"preview", &place).expect("no error"));
        queue.release(taken);
        let taken = queue.take().expect("a job");
        fs::write(&place.file, "sou").expect("writes");
        assert!(!queue.show(&taken, b"preview", &place).expect("no error"));
        assert_eq!(fs::read(&place.file).expect("reads"), b"sou");
    }

    #[test]
    fn an_exchange_waits_for_the_processor_to_write() {
        let (_dir, place) = place("sou");
        let queue = Queue::default();
        queue.push(job("a.glb", "1"));
        let mut taken = queue.take().expect("a job");
        thread::scope(|scope| {
            let exchange = scope.spawn(|| queue.deliver(&mut taken, Bytes::from_static(b"levels"), &place));
            thread::sleep(EXCHANGE_PAUSE * 2);
            assert_eq!(fs::read(&place.file).expect("reads"), b"sou");
            fs::write(&place.file, "source").expect("writes");
            assert_eq!(exchange.join().expect("no panic").expect("exchanges"), Delivery::Done);
        });
        assert_eq!(fs::read(&place.file).expect("reads"), b"levels");
    }

    #[test]
    fn an_exchange_waits_for_the_processor_to_be_done_with_the_file() {
        let (_dir, place, queue, mut taken) = passed_through();
        let path = std::path::Path::new("a.glb");
        let processing = place.activity.processing(path);
        assert!(!queue.show(&taken, b"preview", &place).expect("no error"));
        assert_eq!(fs::read(&place.file).expect("reads"), b"source");
        drop(processing);
        let delivery = queue.deliver(&mut taken, Bytes::from_static(b"levels"), &place);
        assert_eq!(delivery.expect("exchanges"), Delivery::Done);
    }

    #[test]
    fn an_awaited_job_answers_or_closes() {
        let queue = Queue::default();
        let (awaited, answer) = Job::awaited(order("a.glb", "1"));
        queue.push(awaited);
        let mut taken = queue.take().expect("a job");
        let glb = Bytes::from_static(b"levels");
        let (_dir, place) = place("source");
        let delivery = queue.deliver(&mut taken, glb.clone(), &place);
        assert_eq!((delivery.expect("sends"), answer.recv_blocking()), (Delivery::Done, Ok(glb)));
        queue.release(taken);
        let (awaited, answer) = Job::awaited(order("b.glb", "1"));
        queue.push(awaited);
        queue.close();
        assert!(answer.recv_blocking().is_err() && queue.take().is_none());
    }
}
