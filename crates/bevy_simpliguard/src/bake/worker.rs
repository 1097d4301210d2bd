//! The threads that bake while the game runs.

use std::sync::Arc;
use std::time::{Duration, Instant};
use std::{io, thread};

use bevy::asset::AssetPath;
use bevy::prelude::*;
use bevy::tasks::block_on;
use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::{Context, Error, PreviewSink, Progress, ProgressSink, Report, Status};
use simpliguard_bake::{BakeResult, CachedBake, Host, Isolation, Notice, Parts, Processor, isolation};
use thread_priority::{ThreadPriority, ThreadPriorityValue};

use super::baker::Baker;
use super::events::{BakeFinished, BakeProgress, BakeStarted, Event};
use super::input::{Files, SourceFiles};
use super::queue::{Goal, InFlight};
use super::sources::processed_file;
use super::swap::{Delivery, Place};
use crate::options::BakePriority;

/// Number of threads for each bake that runs at the same time. Each bake holds a model and its levels in memory.
const THREADS_PER_BAKE: usize = 4;
/// Largest number of bakes at the same time.
const MOST_BAKES: usize = 4;
/// The thread priority of [`BakePriority::Low`]: a nice value of 9; on Windows, below normal.
const LOW: u8 = 25;

/// What bakes may take of the machine.
#[derive(Clone, Copy)]
pub(super) struct Share {
    /// Number of threads that compute.
    pub(super) threads: usize,
    pub(super) priority: BakePriority,
    /// True if each bake runs in a process of its own.
    pub(super) isolate: bool,
    /// The processor that refines levels.
    pub(super) processor: Processor,
}

/// Starts the workers, which end when the queue is closed.
pub(super) fn start(baker: &Arc<Baker>, files: &Files, share: Share) -> io::Result<()> {
    let Share { threads, priority, isolate, processor } = share;
    let workers = (threads / THREADS_PER_BAKE).clamp(1, MOST_BAKES);
    let isolation = isolate.then(|| Isolation::new(threads / workers)).transpose()?;
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("simpliguard {i}"))
        .start_handler(move |_| set_priority(priority))
        .build()
        .map_err(io::Error::other)?;
    let pool = Arc::new(pool);
    for i in 0..workers {
        let (baker, files) = (baker.clone(), files.clone());
        let worker = Worker { baker, files, pool: pool.clone(), isolation: isolation.clone(), processor };
        thread::Builder::new().name(format!("simpliguard bake {i}")).spawn(move || worker.run())?;
    }
    Ok(())
}

/// Bakes one model for the game that has started this process, and ends it.
pub(super) fn serve(priority: BakePriority) -> ! {
    // A game asks for no sheet.
    isolation::serve(&|_, _| Ok(Vec::new()), move || set_priority(priority))
}

/// Sets the priority of the calling thread.
fn set_priority(priority: BakePriority) {
    let priority = match priority {
        BakePriority::Lowest => ThreadPriority::Min,
        BakePriority::Low => {
            ThreadPriorityValue::try_from(LOW).map_or(ThreadPriority::Min, ThreadPriority::Crossplatform)
        }
        BakePriority::Normal => return,
    };
    if let Err(error) = priority.set_for_current() {
        debug!("bakes run at the priority of the game: {error:?}");
    }
}

struct Worker {
    baker: Arc<Baker>,
    files: Files,
    pool: Arc<ThreadPool>,
    isolation: Option<Isolation>,
    processor: Processor,
}

/// The reason why a job has no result.
enum Stop {
    /// The model or its settings have changed meanwhile, and another job bakes the new levels.
    Superseded,
    /// The bake failed.
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
        while let Some(mut in_flight) = self.baker.queue.take() {
            if self.is_still_missing(&in_flight) {
                self.baker.queue.release(in_flight);
                continue;
            }
            let path = in_flight.job.request.path.clone();
            match self.work(&mut in_flight) {
                Ok(finished) => self.baker.tell(Event::Finished(in_flight.job.request.key, finished)),
                Err(Stop::Superseded) => debug!("{path}: the bake is outdated"),
                Err(Stop::Failed(error)) => self.baker.fail(&path, Some(in_flight.job.request.key), error),
            }
            self.baker.queue.release(in_flight);
        }
    }

    fn is_still_missing(&self, in_flight: &InFlight) -> bool {
        let missing = &in_flight.job.missing;
        !missing.is_empty() && !missing.iter().any(|path| block_on(self.files.exists(path)))
    }

    /// Finds or bakes the levels of a job, and delivers them.
    fn work(&self, in_flight: &mut InFlight) -> Result<BakeFinished, Stop> {
        let path = in_flight.job.request.path.clone();
        let unreadable = |error| Stop::Failed(format!("{path}: {error}"));
        let files = block_on(SourceFiles::read(&self.files, &path)).map_err(unreadable)?;
        let (settings, cache) = (in_flight.job.request.settings.clone(), in_flight.job.request.cache.clone());
        let bake = CachedBake::new(files.source(), &settings, Parts::Combined, cache.as_deref())?;
        let bake = bake.isolated(self.isolation.as_ref()).on(self.processor);
        if bake.key() != in_flight.job.request.key {
            if !self.baker.queue.rekey(in_flight, bake.key()) {
                return Err(Stop::Superseded);
            }
            self.baker.tell(Event::Desired { path: path.clone(), key: bake.key(), is_cached: false });
        }
        in_flight.job.missing = files.missing(&path);
        let (BakeResult { combined, report, .. }, duration) = self.find_or_bake(&bake, in_flight)?;
        let undelivered = |error| Stop::Failed(format!("{path}: the levels cannot be put in place: {error}"));
        if self.deliver(in_flight, combined).map_err(undelivered)? == Delivery::Superseded {
            return Err(Stop::Superseded);
        }
        info!("{}", summary(&path, &report, duration));
        for warning in report.all_levels().filter_map(|level| level.warning.as_ref()) {
            warn!("{path}: {warning}");
        }
        // What is known of each object of a scene is in the report.
        if report.objects.is_empty() {
            let warnings: Vec<&String> = report.levels.iter().filter_map(|level| level.warning.as_ref()).collect();
            report.notes.iter().filter(|note| !warnings.contains(note)).for_each(|note| info!("{path}: {note}"));
        }
        Ok(BakeFinished { path, report, duration })
    }

    /// The result of a bake, and the time that it took; zero if the cache had the result.
    fn find_or_bake(&self, bake: &CachedBake<'_>, in_flight: &InFlight) -> Result<(BakeResult, Duration), Stop> {
        let (start, host) = (Instant::now(), WorkerHost { worker: self, in_flight });
        let preview = in_flight.job.is_swapped_in().then_some(&host as &dyn PreviewSink);
        let cancellation = in_flight.cancellation.clone();
        let memory = Some(self.baker.memory);
        let context = Context { cancellation, progress: Some(&host), preview, memory, ..Context::default() };
        let outcome = bake.run(&context, &host);
        self.baker.attempts.end(bake.key());
        let outcome = outcome?;
        Ok((outcome.result, if outcome.is_cached { Duration::ZERO } else { start.elapsed() }))
    }

    /// Delivers a result to the goal of its job.
    fn deliver(&self, in_flight: &mut InFlight, glb: Vec<u8>) -> io::Result<Delivery> {
        let request = &in_flight.job.request;
        let glb = processed_file(&self.baker.journal, &request.path, &request.settings, glb);
        if let Goal::Answer(answer) = &in_flight.job.goal {
            let is_sent = answer.try_send(glb.into()).is_ok();
            return Ok(if is_sent { Delivery::Done } else { Delivery::Superseded });
        }
        // A missing file may be added while the game is off, so the next start has to process the model again.
        let settle = |in_flight: &InFlight| {
            if in_flight.job.missing.is_empty() {
                self.baker.settle(&in_flight.job.request);
            }
        };
        let path = in_flight.job.request.path.clone();
        let delivery = self.place_of(&path)?.deliver(&self.baker.queue, in_flight, &glb, settle)?;
        if delivery == Delivery::Done {
            self.baker.tell(Event::Swapped(path));
        }
        Ok(delivery)
    }

    fn place_of(&self, path: &AssetPath<'static>) -> io::Result<Place> {
        let Baker { journal, activity, .. } = &*self.baker;
        Ok(Place { file: journal.processed_file(path), scratch: journal.scratch()?, activity: activity.clone() })
    }
}

/// The game around a bake.
struct WorkerHost<'a> {
    worker: &'a Worker,
    in_flight: &'a InFlight,
}

impl WorkerHost<'_> {
    fn path(&self) -> &AssetPath<'static> {
        &self.in_flight.job.request.path
    }

    fn tell(&self, event: impl FnOnce(simpliguard::Key, AssetPath<'static>) -> Event) {
        self.worker.baker.tell(event(self.in_flight.job.request.key, self.path().clone()));
    }
}

impl Host for WorkerHost<'_> {
    fn begin(&self) -> Result<(), Error> {
        self.worker.baker.attempts.begin(&self.path().to_string(), self.in_flight.job.request.key)?;
        self.tell(|key, path| Event::Started(key, BakeStarted { path }));
        Ok(())
    }

    fn compute<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.worker.pool.install(work)
    }

    fn notify(&self, notice: Notice) {
        if notice.is_warning() {
            warn!("{}: {notice}", self.path());
        } else {
            debug!("{}: {notice}", self.path());
        }
    }
}

impl ProgressSink for WorkerHost<'_> {
    fn report(&self, Progress { stage, fraction, .. }: Progress) {
        self.tell(|key, path| Event::Progress(key, BakeProgress { path, stage, fraction }));
    }
}

/// Shows levels in the game while better ones are made.
impl PreviewSink for WorkerHost<'_> {
    fn show(&self, glb: Vec<u8>) {
        let (queue, request) = (&self.worker.baker.queue, &self.in_flight.job.request);
        match self.worker.place_of(&request.path).and_then(|place| place.show(queue, request, &glb)) {
            Ok(true) => self.worker.baker.tell(Event::Swapped(request.path.clone())),
            Ok(false) => {}
            Err(error) => debug!("{}: no preview: {error}", request.path),
        }
    }
}

/// One line for the log.
fn summary(path: &AssetPath<'static>, report: &Report, duration: Duration) -> String {
    let faces: Vec<String> = report.levels.iter().map(|level| level.faces.to_string()).collect();
    match report.status {
        Status::Baked if !report.objects.is_empty() => format!(
            "{path}: {} triangles, levels of {} kinds of objects after {:.1} s",
            report.source_faces,
            report.objects.len(),
            duration.as_secs_f64()
        ),
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
