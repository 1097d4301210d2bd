//! The process that bakes one model for its parent.

use std::io;
use std::process::exit;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::{Context, Error, PreviewSink, Progress, ProgressSink};

use super::messages::{CHILD_VAR, Message, Parts as Written};
use super::request::{Request, Wanted};
use crate::cached::CachedBake;
use crate::host::{Host, Notice};
use crate::result::{BakeResult, DrawSheet, Parts};

/// Where the out-of-memory killer looks first, from -1000 to 1000. The parent has 0.
const OOM_SCORE: &str = "500";

/// Tells whether this process was started by [`Isolation`](super::Isolation) to bake one model. It then calls [`serve`] as
/// early as it can, and ends.
pub fn is_child() -> bool {
    std::env::var_os(CHILD_VAR).is_some()
}

/// Bakes the model that the parent asks for, and ends the process. `draw` makes the contact sheet if the parent wants one;
/// `start_thread` is called on each thread that computes.
pub fn serve(draw: DrawSheet<'_>, start_thread: impl Fn() + Send + Sync + 'static) -> ! {
    // Only Linux has the file.
    let _ = std::fs::write("/proc/self/oom_score_adj", OOM_SCORE);
    // The parent sees the end of this process, if it is there still.
    exit(answer(draw, start_thread).is_err().into())
}

fn answer(draw: DrawSheet<'_>, start_thread: impl Fn() + Send + Sync + 'static) -> io::Result<()> {
    Message::Ready.send()?;
    let request = Request::read(&mut io::stdin().lock())?;
    thread::spawn(end_with_parent);
    let pool = ThreadPoolBuilder::new()
        .num_threads(request.header.threads)
        .start_handler(move |_| start_thread())
        .build()
        .map_err(io::Error::other)?;
    match bake(&request, draw, pool) {
        Ok(result) => Message::Done(Box::new(Written::write(&result, &request.header.folder)?)).send(),
        Err(error) => Message::Failed(error).send(),
    }
}

/// The parent keeps its end of the input open for as long as it wants the result.
fn end_with_parent() {
    let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
    exit(1);
}

fn bake(request: &Request, draw: DrawSheet<'_>, pool: ThreadPool) -> Result<BakeResult, Error> {
    let parts = match request.header.wanted {
        Wanted::Combined => Parts::Combined,
        Wanted::Levels => Parts::Levels,
        Wanted::Sheet => Parts::Sheet(draw),
    };
    let cache = request.cache();
    let bake = CachedBake::new(request.source(), &request.settings, parts, cache.as_ref())?;
    let bake = bake.on(request.header.processor);
    let host = ChildHost { request, pool, previews: AtomicUsize::new(0) };
    let preview = request.header.preview.then_some(&host as &dyn PreviewSink);
    let context = Context { progress: Some(&host), preview, memory: request.header.memory, ..Context::default() };
    bake.make(&context, &host)
}

/// The child around a bake: everything goes to the parent.
struct ChildHost<'a> {
    request: &'a Request,
    pool: ThreadPool,
    /// Number of previews so far.
    previews: AtomicUsize,
}

/// A parent that is gone is noticed by [`end_with_parent`].
fn tell(message: &Message) {
    let _ = message.send();
}

impl Host for ChildHost<'_> {
    fn compute<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.pool.install(work)
    }

    fn notify(&self, notice: Notice) {
        tell(&Message::Notice { text: notice.to_string(), is_warning: notice.is_warning() });
    }

    fn object(&self, name: &str, is_cached: bool) {
        tell(&Message::Object { name: name.to_owned(), is_cached });
    }
}

impl ProgressSink for ChildHost<'_> {
    fn report(&self, progress: Progress) {
        tell(&progress.into());
    }
}

impl PreviewSink for ChildHost<'_> {
    fn show(&self, glb: Vec<u8>) {
        let name = format!("preview_{}.glb", self.previews.fetch_add(1, Ordering::Relaxed));
        if std::fs::write(self.request.header.folder.join(&name), glb).is_ok() {
            tell(&Message::Preview(name));
        }
    }
}
