//! The default asset source: the folders of `AssetPlugin`, with this plugin between the files and the processor.
//!
//! A source has to be registered before `AssetPlugin` is built, but its folders are known only afterwards. So the parts
//! of the source wait for [`Folders::open`].

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use async_lock::{OnceCell, Semaphore};
use bevy::asset::io::file::{FileAssetReader, FileAssetWriter};
use bevy::asset::io::{
    AssetReader, AssetReaderError, AssetSource, AssetSourceBuilder, AssetSourceEvent, AssetWatcher, AssetWriter,
    AssetWriterError, ErasedAssetWriter, PathStream, Reader, Writer,
};
use bevy::prelude::*;

use super::activity::ProcessorActivity;
use super::readers::{GatedReader, written};
use super::watch;

/// Time without a change to a file before Bevy's watcher reports the change.
const DEBOUNCE: Duration = Duration::from_millis(100);
/// Most processed models that are read at the same time; see [`super::readers`]. Ninety nested loads overflow the 2 MiB of a
/// thread in debug builds.
const MOST_MODELS: usize = 16;

/// A value that is set when the folders are known.
type Late<T> = Arc<OnceCell<T>>;

/// The parts of the source, which wait until the folders are known.
#[derive(Resource, Default)]
pub(super) struct Folders {
    source: Late<FileAssetReader>,
    source_writer: Late<FileAssetWriter>,
    processed: Late<FileAssetReader>,
    processed_writer: Late<FileAssetWriter>,
    source_watch: Hook,
    processed_watch: Hook,
    activity: Arc<ProcessorActivity>,
}

/// The use that a game makes of its folders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// The game processes the source.
    Process,
    /// The game reads the files that another game processes.
    ReadProcessed,
    /// The game has no processor.
    Plain,
}

impl Folders {
    /// The activity around the processed files.
    pub(super) fn activity(&self) -> &Arc<ProcessorActivity> {
        &self.activity
    }

    /// The source. Without `process` its processed files cannot be written: Bevy's processor leaves the source alone,
    /// and the game reads the files that are there.
    pub(super) fn source(&self, process: bool) -> AssetSourceBuilder {
        let reader = |files: &Late<FileAssetReader>, is_processed| {
            let (files, activity) = (files.clone(), self.activity.clone());
            LateReader { files, is_processed, activity, places: Arc::new(Semaphore::new(MOST_MODELS)) }
        };
        let (source, processed) = (reader(&self.source, false), reader(&self.processed, true));
        let source_writer = LateWriter { files: self.source_writer.clone(), writes: None };
        let processed_writer = LateWriter { files: self.processed_writer.clone(), writes: Some(self.activity.clone()) };
        let (source_watch, processed_watch) = (self.source_watch.clone(), self.processed_watch.clone());
        AssetSourceBuilder::new(move || Box::new(source.clone()))
            .with_writer(move |_| Some(Box::new(source_writer.clone())))
            .with_watcher(move |sender| Some(source_watch.attach(sender)))
            .with_processed_reader(move || Box::new(processed.clone()))
            .with_processed_writer(move |_| {
                process.then(|| Box::new(processed_writer.clone()) as Box<dyn ErasedAssetWriter>)
            })
            .with_processed_watcher(move |sender| Some(processed_watch.attach(sender)))
    }

    /// Opens the source. The folders are relative to the base of all asset folders.
    pub(super) fn open(&self, source: &str, processed: &str, usage: Use) {
        // Folders that are watched have to exist, so the writers create them.
        let _ = self.source.set_blocking(FileAssetReader::new(source));
        let _ = self.source_writer.set_blocking(FileAssetWriter::new(source, false));
        let _ = self.processed.set_blocking(FileAssetReader::new(processed));
        let _ = self.processed_writer.set_blocking(FileAssetWriter::new(processed, usage == Use::Process));
        if usage == Use::Process {
            let activity = self.activity.clone();
            self.source_watch.start(source, |changes, out| watch::pass_on_settled(source, changes, out, activity));
            let activity = self.activity.clone();
            self.processed_watch
                .start(processed, |changes, out| watch::pass_on_news(processed, changes, out, activity));
        } else {
            self.processed_watch.start_plain(processed);
        }
        if usage == Use::Plain {
            self.source_watch.start_plain(source);
        }
    }
}

type Sender = async_channel::Sender<AssetSourceEvent>;
type Receiver = async_channel::Receiver<AssetSourceEvent>;

/// A watcher that starts later: its listener, and the watcher itself.
#[derive(Clone, Default)]
struct Hook {
    listener: Arc<Mutex<Option<Sender>>>,
    watcher: Arc<Mutex<Option<Box<dyn AssetWatcher>>>>,
}

impl Hook {
    /// Keeps the listener of the source. The source owns the returned watcher.
    fn attach(&self, listener: Sender) -> Box<dyn AssetWatcher> {
        *locked(&self.listener) = Some(listener);
        Box::new(self.clone())
    }

    /// Watches a folder if the source listens. `between` passes on the changes.
    fn start(&self, folder: &str, between: impl FnOnce(Receiver, Sender)) {
        let Some(listener) = locked(&self.listener).take() else { return };
        let (sender, changes) = async_channel::unbounded();
        *locked(&self.watcher) = AssetSource::get_default_watcher(folder.to_owned(), DEBOUNCE)(sender);
        between(changes, listener);
    }

    /// Watches a folder if the source listens, and passes on all changes.
    fn start_plain(&self, folder: &str) {
        let Some(listener) = locked(&self.listener).take() else { return };
        *locked(&self.watcher) = AssetSource::get_default_watcher(folder.to_owned(), DEBOUNCE)(listener);
    }
}

impl AssetWatcher for Hook {}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads files once the folders are known.
#[derive(Clone)]
struct LateReader {
    files: Late<FileAssetReader>,
    /// True if the files are the processed ones.
    is_processed: bool,
    activity: Arc<ProcessorActivity>,
    /// The places of models that are read at the same time.
    places: Arc<Semaphore>,
}

/// Tells whether Bevy's glTF loader reads a file. The buffers and images that the loader reads besides have other extensions and
/// never wait for a place.
fn is_model(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    ["glb", "gltf"].iter().any(|model| extension.eq_ignore_ascii_case(model))
}

impl LateReader {
    /// Opens the file at `file` once it may be read.
    async fn open<R: Reader>(
        &self,
        path: &Path,
        file: &Path,
        inner: impl Future<Output = Result<R, AssetReaderError>>,
    ) -> Result<GatedReader<R>, AssetReaderError> {
        if self.is_processed {
            let reading = self.activity.reading(path);
            let place = if is_model(file) { Some(self.places.acquire_arc().await) } else { None };
            return Ok(GatedReader::of_processed(inner.await?, reading, place));
        }
        written(file).await;
        Ok(GatedReader::of_source(inner.await?, &self.activity, path))
    }
}

impl AssetReader for LateReader {
    async fn read<'a>(&'a self, path: &'a Path) -> Result<impl Reader + 'a, AssetReaderError> {
        let files = self.files.wait().await;
        let file = files.root_path().join(path);
        if self.is_processed {
            self.activity.read(path, &file);
        }
        self.open(path, &file, AssetReader::read(files, path)).await
    }

    async fn read_meta<'a>(&'a self, path: &'a Path) -> Result<impl Reader + 'a, AssetReaderError> {
        let files = self.files.wait().await;
        let mut file = files.root_path().join(path).into_os_string();
        file.push(".meta");
        if !self.is_processed {
            // With the `.meta` begins a look of the processor at the source.
            self.activity.looked_at(path);
        }
        self.open(path, Path::new(&file), AssetReader::read_meta(files, path)).await
    }

    async fn read_directory<'a>(&'a self, path: &'a Path) -> Result<Box<PathStream>, AssetReaderError> {
        AssetReader::read_directory(self.files.wait().await, path).await
    }

    async fn is_directory<'a>(&'a self, path: &'a Path) -> Result<bool, AssetReaderError> {
        AssetReader::is_directory(self.files.wait().await, path).await
    }
}

/// Writes files once the folders are known.
#[derive(Clone)]
struct LateWriter {
    files: Late<FileAssetWriter>,
    /// Records the writes of processed files.
    writes: Option<Arc<ProcessorActivity>>,
}

impl LateWriter {
    fn note(&self, path: &Path) {
        if let Some(writes) = &self.writes {
            writes.wrote(path);
        }
    }
}

impl AssetWriter for LateWriter {
    async fn write<'a>(&'a self, path: &'a Path) -> Result<Box<Writer>, AssetWriterError> {
        self.note(path);
        if let Some(writes) = &self.writes {
            writes.held(path);
            // The write would be lost if the file were swapped afterwards.
            writes.swap_ended(path).await;
        }
        AssetWriter::write(self.files.wait().await, path).await
    }

    async fn write_meta<'a>(&'a self, path: &'a Path) -> Result<Box<Writer>, AssetWriterError> {
        self.note(path);
        if let Some(writes) = &self.writes {
            // The next step of the processor is the end of its transaction.
            writes.released(path);
        }
        AssetWriter::write_meta(self.files.wait().await, path).await
    }

    async fn remove<'a>(&'a self, path: &'a Path) -> Result<(), AssetWriterError> {
        self.note(path);
        AssetWriter::remove(self.files.wait().await, path).await
    }

    async fn remove_meta<'a>(&'a self, path: &'a Path) -> Result<(), AssetWriterError> {
        self.note(path);
        AssetWriter::remove_meta(self.files.wait().await, path).await
    }

    async fn rename<'a>(&'a self, old: &'a Path, new: &'a Path) -> Result<(), AssetWriterError> {
        self.note(old);
        self.note(new);
        AssetWriter::rename(self.files.wait().await, old, new).await
    }

    async fn rename_meta<'a>(&'a self, old: &'a Path, new: &'a Path) -> Result<(), AssetWriterError> {
        self.note(old);
        self.note(new);
        AssetWriter::rename_meta(self.files.wait().await, old, new).await
    }

    async fn create_directory<'a>(&'a self, path: &'a Path) -> Result<(), AssetWriterError> {
        AssetWriter::create_directory(self.files.wait().await, path).await
    }

    async fn remove_directory<'a>(&'a self, path: &'a Path) -> Result<(), AssetWriterError> {
        AssetWriter::remove_directory(self.files.wait().await, path).await
    }

    async fn remove_empty_directory<'a>(&'a self, path: &'a Path) -> Result<(), AssetWriterError> {
        AssetWriter::remove_empty_directory(self.files.wait().await, path).await
    }

    async fn remove_assets_in_directory<'a>(&'a self, path: &'a Path) -> Result<(), AssetWriterError> {
        AssetWriter::remove_assets_in_directory(self.files.wait().await, path).await
    }
}
