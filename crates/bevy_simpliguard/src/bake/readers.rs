//! Readers between the files and Bevy. They wait in three cases.
//!
//! First, a source is not read while it is being written, because half a file would be read.
//!
//! Second, a source does not reach its end before the processor may ask for the lock of the processed file. In Bevy
//! 0.19 a load takes the read lock twice: with the `.meta` and, while it holds that, with the file
//! (`AssetServer::get_meta_loader_and_reader`). The processor asks for the write lock after it has hashed the source
//! (`AssetProcessor::process_asset_internal`), and while a writer waits, no reader gets the lock. If the processor asks
//! between the two read locks of a load, load and processor wait for each other for ever. The same happens if it asks
//! while it is already processing the file, because a load may come in between.
//!
//! Third, only some processed models are read at the same time. While Bevy's glTF loader waits for the textures of a model, its
//! thread runs other tasks, and those may be loads that wait in turn: each lies on the stack of the last one, and a hundred
//! overflow it (bevyengine/bevy#15271).

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};

use async_io::Timer;
use async_lock::SemaphoreGuardArc;
use bevy::asset::io::{Reader, ReaderNotSeekableError, STACK_FUTURE_SIZE, SeekableReader, StackFuture};
use bevy::tasks::futures_lite::AsyncRead;

use super::activity::{Guard, ProcessorActivity};
use super::timing::{PATIENCE, QUIET, TICK};

/// Time without a change after which a file counts as written although it is not whole.
const LONG_QUIET: Duration = Duration::from_secs(2);

/// Waits until a file is written. Does not wait for a missing file.
pub(super) async fn written(file: &Path) {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        match age(file) {
            Ok(age) if age < QUIET => Timer::after(QUIET - age).await,
            Ok(age) if age < LONG_QUIET && !is_whole(file).unwrap_or(true) => Timer::after(TICK).await,
            _ => return,
        };
    }
}

/// Time since the last change of a file. A time in the future comes from another machine's clock and counts as long
/// ago.
fn age(file: &Path) -> io::Result<Duration> {
    Ok(fs::metadata(file)?.modified()?.elapsed().unwrap_or(LONG_QUIET))
}

/// Tells whether a file is whole: not empty and, if it is a binary glTF, as long as its header says.
fn is_whole(file: &Path) -> io::Result<bool> {
    let (mut file, mut header) = (fs::File::open(file)?, Vec::new());
    file.by_ref().take(12).read_to_end(&mut header)?;
    Ok(match header[..] {
        [] => false,
        [b'g', b'l', b'T', b'F', _, _, _, _, a, b, c, d] => {
            file.metadata()?.len() >= u64::from(u32::from_le_bytes([a, b, c, d]))
        }
        _ => true,
    })
}

/// Reads a source or a processed file.
pub(super) struct GatedReader<R> {
    inner: R,
    /// The gate before the end of a source.
    gate: Option<Gate>,
    /// Records that a processed file is being read.
    _reading: Option<Guard>,
    /// The place among the models that are read at the same time.
    _place: Option<SemaphoreGuardArc>,
}

/// Opens when the processor may ask for the lock of the processed file.
struct Gate {
    activity: Arc<ProcessorActivity>,
    path: PathBuf,
    pause: Option<Timer>,
}

impl<R: Reader> GatedReader<R> {
    /// A reader of a source. The processor reads a source twice, and only the first reader has a gate.
    pub(super) fn of_source(inner: R, activity: &Arc<ProcessorActivity>, path: &Path) -> Self {
        let gate = Gate { activity: activity.clone(), path: path.to_owned(), pause: None };
        Self { inner, gate: (!activity.is_claimed(path, Instant::now())).then_some(gate), _reading: None, _place: None }
    }

    /// A reader of a processed file, with a place among the models that are read at the same time if it is one.
    pub(super) fn of_processed(inner: R, reading: Guard, place: Option<SemaphoreGuardArc>) -> Self {
        Self { inner, gate: None, _reading: Some(reading), _place: place }
    }
}

impl Gate {
    fn poll_passed(&mut self, context: &mut Context<'_>) -> Poll<()> {
        while !self.activity.claim(&self.path, Instant::now()) {
            let pause = self.pause.get_or_insert_with(|| Timer::after(TICK));
            ready!(Future::poll(Pin::new(pause), context));
            self.pause = None;
        }
        Poll::Ready(())
    }
}

impl<R: Reader> AsyncRead for GatedReader<R> {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        let read = ready!(Pin::new(&mut self.inner).poll_read(context, buffer));
        if let (Ok(0), Some(gate)) = (&read, &mut self.gate) {
            ready!(gate.poll_passed(context));
            self.gate = None;
        }
        Poll::Ready(read)
    }
}

impl<R: Reader> Reader for GatedReader<R> {
    /// Reads to the end without the gate: the processor hashes piece by piece, and only that has to wait.
    fn read_to_end<'a>(&'a mut self, buffer: &'a mut Vec<u8>) -> StackFuture<'a, io::Result<usize>, STACK_FUTURE_SIZE> {
        self.inner.read_to_end(buffer)
    }

    fn seekable(&mut self) -> Result<&mut dyn SeekableReader, ReaderNotSeekableError> {
        self.inner.seekable()
    }
}

#[cfg(test)]
mod tests {
    use std::thread;
    use std::time::SystemTime;

    use bevy::asset::io::VecReader;
    use bevy::tasks::block_on;
    use bevy::tasks::futures_lite::AsyncReadExt;

    use super::*;

    /// Reads as the processor does when it hashes.
    async fn hash(mut reader: GatedReader<VecReader>) -> usize {
        let (mut bytes, mut buffer) = (0, [0; 2]);
        loop {
            match reader.read(&mut buffer).await.expect("reads") {
                0 => return bytes,
                n => bytes += n,
            }
        }
    }

    #[test]
    fn a_source_has_no_end_while_the_processed_file_is_read() {
        let (activity, path) = (Arc::new(ProcessorActivity::default()), Path::new("a.glb"));
        let source = |path: &str| GatedReader::of_source(VecReader::new(vec![1; 5]), &activity, Path::new(path));
        let [meta, file] = [(); 2].map(|()| activity.reading(path));
        assert_eq!(block_on(hash(source("b.glb"))), 5);
        let (mut bytes, mut whole) = (Vec::new(), source("a.glb"));
        assert_eq!(block_on(Reader::read_to_end(&mut whole, &mut bytes)).expect("reads"), 5);
        let [first, second] = [(); 2].map(|()| source("a.glb"));
        thread::scope(|scope| {
            let first = scope.spawn(|| block_on(hash(first)));
            drop(meta);
            thread::sleep(TICK * 3);
            assert!(!first.is_finished());
            drop(file);
            assert_eq!(first.join().expect("no panic"), 5);
            // The processor has asked for the lock. Its second reader has no gate, but those of others have.
            assert_eq!(block_on(hash(source("a.glb"))), 5);
            activity.held(path);
            let second = scope.spawn(|| block_on(hash(second)));
            thread::sleep(TICK * 3);
            assert!(!second.is_finished());
            activity.released(path);
            assert_eq!(second.join().expect("no panic"), 5);
        });
        // The processor has found nothing to do, and looks again while the file is loaded.
        activity.looked_at(path);
        let (again, meta) = (source("a.glb"), activity.reading(path));
        thread::scope(|scope| {
            let again = scope.spawn(|| block_on(hash(again)));
            thread::sleep(TICK * 3);
            assert!(!again.is_finished());
            drop(meta);
            assert_eq!(again.join().expect("no panic"), 5);
        });
    }

    #[test]
    fn a_file_that_is_being_written_is_waited_for() {
        let dir = tempfile::tempdir().expect("tempdir");
        let file = dir.path().join("a.glb");
        block_on(written(&file));
        fs::write(&file, "1").expect("writes");
        thread::scope(|scope| {
            let wait = scope.spawn(|| block_on(written(&file)));
            let mut last = Instant::now();
            for size in 0..4 {
                thread::sleep(QUIET / 4);
                last = Instant::now();
                fs::write(&file, vec![1; size]).expect("writes");
            }
            wait.join().expect("no panic");
            assert!(last.elapsed() >= QUIET * 9 / 10);
        });
        let start = Instant::now();
        fs::write(&file, b"glTF\x02\0\0\0\x0e\0\0\0J").expect("writes");
        assert!(!is_whole(&file).expect("reads"));
        block_on(written(&file));
        assert!(start.elapsed() >= LONG_QUIET * 9 / 10);
        for whole in [&b"glTF\x02\0\0\0\x0e\0\0\0JS"[..], b"{}"] {
            fs::write(&file, whole).expect("writes");
            assert!(is_whole(&file).expect("reads"));
        }
        let tomorrow = SystemTime::now() + Duration::from_secs(86_400);
        let start = Instant::now();
        block_on(written(&file));
        fs::File::options().write(true).open(&file).and_then(|f| f.set_modified(tomorrow)).expect("sets");
        block_on(written(&file));
        assert!(start.elapsed() < PATIENCE / 2);
    }
}
