//! The threads that bake while the game runs.

use std::sync::Arc;
use std::time::{Duration, Instant};
use std::{io, thread};

use bevy::asset::AssetPath;
use bevy::prelude::*;
use bevy::tasks::block_on;
use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::{Context, Error, PreviewSink, Progress, ProgressSink, Report, StageStore, Status};
use simpliguard_cache::{BakeResult, Notice, Once, bake_key};
use thread_priority::{ThreadPriority, ThreadPriorityValue};

use super::baker::{Baker, Order};
use super::events::{BakeFinished, BakeProgress, BakeStarted, Event};
use super::input::{Files, SourceFiles};
use super::queue::{Delivery, Place, Taken};
use crate::BakePriority;

/// Threads that share a bake before a second one runs beside it: each holds a model and its levels in memory.
const THREADS_PER_BAKE: usize = 4;
const MOST_BAKES: usize = 4;
/// A nice value of 9; on Windows below normal.
const LOW: u8 = 25;
/// What computes a result; part of its record, not of its key.
const MADE_BY: &str = "cpu";

/// Starts the workers, which end when the queue is closed. `threads` is how many compute.
pub(super) fn start(baker: &Arc<Baker>, files: &Files, threads: usize, priority: BakePriority) -> io::Result<()> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("simpliguard {i}"))
        .start_handler(move |_| stand_back(priority))
        .build()
        .map_err(io::Error::other)?;
    let pool = Arc::new(pool);
    for i in 0..(threads / THREADS_PER_BAKE).clamp(1, MOST_BAKES) {
        let worker = Worker { baker: baker.clone(), files: files.clone(), pool: pool.clone() };
        thread::Builder::new().name(format!("simpliguard bake {i}")).spawn(move || worker.run())?;
    }
    Ok(())
}

/// Gives the calling thread its priority.
fn stand_back(priority: BakePriority) {
    let priority = match priority {
        BakePriority::Lowest => ThreadPriority::Min,
        BakePriority::Low => {
            ThreadPriorityValue::try_from(LOW).map_or(ThreadPriority::Min, ThreadPriority::Crossplatform)
        }
        BakePriority::Normal => return,
    };
    if let Err(error) = priority.set_for_current() {
        debug!("bakes run at the game's own priority: {error:?}");
    }
}

struct Worker {
    baker: Arc<Baker>,
    files: Files,
    pool: Arc<ThreadPool>,
}

/// Why a job has no result.
enum Stop {
    /// The model or its settings have changed meanwhile; another job is for those.
    Superseded,
    /// It cannot be baked.
    Failed(String),
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        match error {
            Error::Cancelled { .. } => Self::Superseded,
            error => Self::Failed(error.to_string()),
        }
    }
}

impl Worker {
    fn run(&self) {
        while let Some(mut taken) = self.baker.queue.take() {
            if self.is_still_missing(&taken) {
                self.baker.queue.release(taken);
                continue;
            }
            let path = taken.job.order.path.clone();
            match self.work(&mut taken) {
                Ok(finished) => self.baker.tell(Event::Finished(taken.job.order.key, finished)),
                Err(Stop::Superseded) => debug!("{path}: the bake is outdated"),
                Err(Stop::Failed(error)) => self.baker.fail(&path, Some(taken.job.order.key), error),
            }
            self.baker.queue.release(taken);
        }
    }

    fn is_still_missing(&self, taken: &Taken) -> bool {
        let missing = &taken.job.missing;
        !missing.is_empty() && !missing.iter().any(|path| block_on(self.files.exists(path)))
    }

    /// Looks in the cache once more, bakes if need be, and brings the result where it belongs.
    fn work(&self, taken: &mut Taken) -> Result<BakeFinished, Stop> {
        let path = taken.job.order.path.clone();
        let unreadable = |error| Stop::Failed(format!("{path}: {error}"));
        let files = block_on(SourceFiles::read(&self.files, &path)).map_err(unreadable)?;
        let key = bake_key(&files.source(), &taken.job.order.settings)?;
        if key != taken.job.order.key {
            if !self.baker.queue.rekey(taken, key) {
                return Err(Stop::Superseded);
            }
            self.baker.tell(Event::Wished { path: path.clone(), key, cached: false });
        }
        taken.job.missing = files.missing(&path);
        let (result, duration) = self.find_or_bake(&files, taken)?;
        let BakeResult { combined, report, .. } = result;
        let place = self.place_of(&path);
        let delivered = place.and_then(|place| self.baker.queue.deliver(taken, combined.into(), &place));
        match delivered {
            Ok(Delivery::Done) => self.exchanged(&path),
            Ok(Delivery::WasThere) => {}
            Ok(Delivery::Superseded) => return Err(Stop::Superseded),
            Err(error) => return Err(Stop::Failed(format!("{path}: the levels cannot be put in place: {error}"))),
        }
        // Should a missing file come while the game is off, the next start has to look.
        if taken.job.missing.is_empty() {
            self.baker.settle(&taken.job.order);
        }
        info!("{}", summary(&path, &report, duration));
        Ok(BakeFinished { path, report, duration })
    }

    fn place_of(&self, path: &AssetPath<'static>) -> io::Result<Place> {
        let Baker { journal, activity, .. } = &*self.baker;
        Ok(Place { file: journal.processed_file(path), scratch: journal.scratch()?, activity: activity.clone() })
    }

    /// A processed file has other levels.
    fn exchanged(&self, path: &AssetPath<'static>) {
        self.baker.activity.wrote(path.path());
        self.baker.tell(Event::Exchanged(path.clone()));
    }

    /// Nobody bakes what somebody else on this machine bakes already. The duration is that of our own bake.
    fn find_or_bake(&self, files: &SourceFiles, taken: &Taken) -> Result<(BakeResult, Duration), Stop> {
        let (order, start) = (&taken.job.order, Instant::now());
        let bake = || self.bake(files, taken);
        let Some(cache) = &order.cache else { return Ok((bake()?, start.elapsed())) };
        let tell = |notice: Notice| match notice {
            Notice::Waits => debug!("{}: {notice}", order.path),
            Notice::Shared(error) => warn!("{error}"),
        };
        match cache.once(&order.key, &taken.cancellation, tell, || order.cached(), bake)? {
            Once::Found(result) => Ok((result, Duration::ZERO)),
            Once::Made(result) => Ok((result, start.elapsed())),
            Once::Cancelled => Err(Stop::Superseded),
        }
    }

    fn bake(&self, files: &SourceFiles, taken: &Taken) -> Result<BakeResult, Stop> {
        let order = &taken.job.order;
        self.baker.tell(Event::Started(order.key, BakeStarted { path: order.path.clone() }));
        let progress = Sink { baker: &self.baker, order };
        let stages = order.cache.as_deref().map(|cache| cache as &dyn StageStore);
        let preview = Preview { worker: self, taken };
        let preview = taken.job.is_in_background().then_some(&preview as &dyn PreviewSink);
        let context = Context { cancellation: taken.cancellation.clone(), progress: Some(&progress), stages, preview };
        let source = files.source();
        let result = self.pool.install(|| BakeResult::compute(&source, &order.settings, &context, None))?;
        keep(order, &result);
        Ok(result)
    }
}

/// Storage that fails never stops a bake.
fn keep(order: &Order, result: &BakeResult) {
    let Some(cache) = &order.cache else { return };
    let stored = result.to_entry(MADE_BY).map_err(|e| e.to_string());
    if let Err(error) = stored.and_then(|entry| cache.put(&order.key, &entry).map_err(|e| e.to_string())) {
        warn!("{}: the result is not kept: {error}", order.path);
    }
}

struct Sink<'a> {
    baker: &'a Baker,
    order: &'a Order,
}

impl ProgressSink for Sink<'_> {
    fn report(&self, Progress { stage, fraction, .. }: Progress) {
        let message = BakeProgress { path: self.order.path.clone(), stage, fraction };
        self.baker.tell(Event::Progress(self.order.key, message));
    }
}

/// Shows levels in the game while better ones are made.
struct Preview<'a> {
    worker: &'a Worker,
    taken: &'a Taken,
}

impl PreviewSink for Preview<'_> {
    fn show(&self, glb: Vec<u8>) {
        let (worker, path) = (self.worker, &self.taken.job.order.path);
        match worker.place_of(path).and_then(|place| worker.baker.queue.show(self.taken, &glb, &place)) {
            Ok(true) => worker.exchanged(path),
            Ok(false) => {}
            Err(error) => debug!("{path}: no preview: {error}"),
        }
    }
}

/// One line for the log.
fn summary(path: &AssetPath<'static>, report: &Report, duration: Duration) -> String {
    let faces: Vec<String> = report.levels.iter().map(|level| level.faces.to_string()).collect();
    match report.status {
        Status::Baked => format!(
            "{path}: {} triangles, levels of {} after {:.1} s",
            report.source_faces,
            faces.join(", "),
            duration.as_secs_f64()
        ),
        Status::SmallEnough => format!("{path}: {} triangles need no levels", report.source_faces),
        Status::KeptLods => format!("{path}: has levels of its own"),
        Status::PassThrough => format!("{path}: gets no levels"),
    }
}
