//! Swapping: results and previews take the place of processed files.
//!
//! A swap reads the processed file, and replaces it if it still holds the bytes that the processor, or the last swap,
//! has left there. While it does so, the processor does not begin to process the model
//! ([`ProcessorActivity::swapping`]). So the desired levels of the model cannot change during a swap, and stale levels
//! never replace newer ones.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use std::{fs, io, thread};

use simpliguard_cache::{Durability, write_atomic_through};

use super::activity::ProcessorActivity;
use super::queue::{InFlight, Queue};
use super::request::BakeRequest;

/// Number of tries to swap in a result while the processor is writing the file, and the time between them.
const TRIES: u32 = 200;
/// Number of tries to swap in a preview. The bake waits meanwhile.
const PREVIEW_TRIES: u32 = 20;
const PAUSE: Duration = Duration::from_millis(50);

/// The outcome of a delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Delivery {
    /// The result is in place now.
    Done,
    /// The result was in place before.
    WasThere,
    /// Nobody needs the result any more.
    Superseded,
}

/// The place of a processed file.
#[derive(Debug)]
pub(super) struct Place {
    /// The processed file.
    pub(super) file: PathBuf,
    /// A folder on the same file system.
    pub(super) scratch: PathBuf,
    /// The readers and writers of the file.
    pub(super) activity: Arc<ProcessorActivity>,
}

impl Place {
    /// Swaps in the result of a job. Waits while the processor writes the file. `settle` is called once the result is
    /// in place, before the processor may process the model again.
    pub(super) fn deliver(
        &self,
        queue: &Queue,
        in_flight: &mut InFlight,
        glb: &[u8],
        settle: impl Fn(&InFlight),
    ) -> io::Result<Delivery> {
        let hash = blake3::hash(glb);
        let record = || {
            queue.swapped(&in_flight.job.request, hash, true);
            settle(in_flight);
        };
        let swap = || self.swap(queue, &in_flight.job.request, (glb, hash), record);
        let delivery = tried(TRIES, swap)?;
        let delivery = delivery.ok_or_else(|| io::Error::other("another program has written the processed file"))?;
        in_flight.is_delivered |= delivery != Delivery::Superseded;
        Ok(delivery)
    }

    /// Swaps in a preview, until the result is there. Returns whether it was swapped in.
    pub(super) fn show(&self, queue: &Queue, request: &BakeRequest, glb: &[u8]) -> io::Result<bool> {
        let hash = blake3::hash(glb);
        let record = || queue.swapped(request, hash, false);
        Ok(tried(PREVIEW_TRIES, || self.swap(queue, request, (glb, hash), record))? == Some(Delivery::Done))
    }

    /// Swaps the file if it holds the expected bytes, and calls `record`. `None` if it holds other bytes, or while the
    /// processor may be writing it.
    fn swap(
        &self,
        queue: &Queue,
        request: &BakeRequest,
        (glb, hash): (&[u8], blake3::Hash),
        record: impl FnOnce(),
    ) -> io::Result<Option<Delivery>> {
        let path = request.path.path();
        // Bytes that the processor writes into a file that is swapped meanwhile would be lost.
        let swapping = self.activity.swapping(path, Instant::now());
        let Some(expected) = queue.swappable(request) else { return Ok(Some(Delivery::Superseded)) };
        let Some(_swapping) = swapping else { return Ok(None) };
        let Ok(there) = fs::read(&self.file).map(|bytes| blake3::hash(&bytes)) else { return Ok(None) };
        let delivery = if there == hash {
            Delivery::WasThere
        } else if there == expected {
            write_atomic_through(&self.scratch, &self.file, glb, Durability::Process)?;
            self.activity.wrote(path);
            Delivery::Done
        } else {
            return Ok(None);
        };
        record();
        Ok(Some(delivery))
    }
}

/// The outcome of a swap that is tried so many times, until there is one.
fn tried(tries: u32, mut swap: impl FnMut() -> io::Result<Option<Delivery>>) -> io::Result<Option<Delivery>> {
    for _ in 1..tries {
        if let Some(delivery) = swap()? {
            return Ok(Some(delivery));
        }
        thread::sleep(PAUSE);
    }
    swap()
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::path::Path;

    use bevy::tasks::block_on;
    use simpliguard::KeyBuilder;
    use simpliguard::settings::BakeSettings;

    use super::super::queue::Job;
    use super::*;

    fn job(version: &str) -> Job {
        let key = KeyBuilder::new(version).finish();
        let request =
            BakeRequest { path: "a.glb".into(), settings: BakeSettings::default(), key, image_key: key, cache: None };
        Job::swapped_in(request, blake3::hash(b"source"))
    }

    /// A processed file, and a job in flight for its model.
    struct Model {
        _dir: tempfile::TempDir,
        place: Place,
        queue: Queue,
        in_flight: InFlight,
    }

    impl Model {
        fn new(content: &str) -> Self {
            let dir = tempfile::tempdir().expect("tempdir");
            let file = dir.path().join("a.glb");
            fs::write(&file, content).expect("writes");
            let place = Place { file, scratch: dir.path().to_owned(), activity: Arc::default() };
            let queue = Queue::default();
            queue.push(job("1"));
            let in_flight = queue.take().expect("a job");
            Self { _dir: dir, place, queue, in_flight }
        }

        fn deliver(&mut self, glb: &[u8]) -> Delivery {
            self.place.deliver(&self.queue, &mut self.in_flight, glb, |_| {}).expect("no error")
        }

        fn show(&self, glb: &[u8]) -> bool {
            self.place.show(&self.queue, &self.in_flight.job.request, glb).expect("no error")
        }

        fn content(&self) -> Vec<u8> {
            fs::read(&self.place.file).expect("reads")
        }
    }

    #[test]
    fn a_result_takes_the_place_of_the_model_that_it_is_for_alone() {
        let mut model = Model::new("source");
        assert_eq!(model.deliver(b"levels"), Delivery::Done);
        assert_eq!(model.content(), b"levels");
        assert_eq!(model.deliver(b"levels"), Delivery::WasThere);
        model.queue.push(job("2"));
        assert_eq!(model.deliver(b"old levels"), Delivery::Superseded);
        model.queue.forget(&"a.glb".into());
        assert_eq!(model.deliver(b"old levels"), Delivery::Superseded);
        assert_eq!(model.content(), b"levels");
    }

    #[test]
    fn a_preview_gives_way_to_the_result() {
        let mut model = Model::new("source");
        assert!(model.show(b"preview"));
        assert_eq!(model.content(), b"preview");
        assert_eq!(model.deliver(b"levels"), Delivery::Done);
        assert_eq!(model.content(), b"levels");
        // No preview is shown of an outdated bake, nor while the processor writes.
        model.queue.push(job("2"));
        assert!(!model.show(b"preview"));
        let in_flight = model.queue.take().expect("a job");
        let outdated = std::mem::replace(&mut model.in_flight, in_flight);
        model.queue.release(outdated);
        fs::write(&model.place.file, "sou").expect("writes");
        assert!(!model.show(b"preview"));
        assert_eq!(model.content(), b"sou");
    }

    #[test]
    fn a_swap_waits_for_the_processor_to_write() {
        let Model { _dir, place, queue, mut in_flight } = Model::new("sou");
        thread::scope(|scope| {
            let swap = scope.spawn(|| place.deliver(&queue, &mut in_flight, b"levels", |_| {}));
            thread::sleep(PAUSE * 2);
            assert_eq!(fs::read(&place.file).expect("reads"), b"sou");
            fs::write(&place.file, "source").expect("writes");
            assert_eq!(swap.join().expect("no panic").expect("swaps"), Delivery::Done);
        });
        assert_eq!(fs::read(&place.file).expect("reads"), b"levels");
    }

    #[test]
    fn a_swap_waits_for_the_processor_to_end() {
        let mut model = Model::new("source");
        let processing = model.place.activity.processing(Path::new("a.glb"));
        assert!(!model.show(b"preview"));
        assert_eq!(model.content(), b"source");
        drop(processing);
        assert_eq!(model.deliver(b"levels"), Delivery::Done);
    }

    #[test]
    fn the_processor_waits_for_a_swap_to_end_and_the_queue_is_free_meanwhile() {
        let mut model = Model::new("source");
        let (activity, waiting) = (model.place.activity.clone(), Cell::new(None));
        let settle = |in_flight: &InFlight| {
            // The processor begins to process the model again, and asks the queue about another one.
            let activity = activity.clone();
            let processing = activity.processing(Path::new("a.glb"));
            let thread = thread::spawn(move || {
                let _processing = processing;
                block_on(activity.swap_ended(Path::new("a.glb")));
            });
            model.queue.forget(&"b.glb".into());
            assert_eq!(model.queue.swappable(&in_flight.job.request), Some(blake3::hash(b"levels")));
            thread::sleep(PAUSE);
            assert!(!thread.is_finished());
            waiting.set(Some(thread));
        };
        model.place.deliver(&model.queue, &mut model.in_flight, b"levels", settle).expect("swaps");
        waiting.take().expect("settled").join().expect("no panic");
    }
}
