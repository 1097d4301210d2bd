//! Levels at import: an asset processor that never makes a game wait.
//!
//! Bevy gives every `.glb` and `.gltf` file to [`SimpliguardProcess`]. Everything that decides a bake gives a key: the
//! model, the files that it refers to, its `.meta`, the project's settings and the version of the pipeline. If the
//! cache has a result for the key, the result becomes the processed file. If not, the model itself becomes the
//! processed file, so that the game has it at once, and a bake is queued. Its result goes to the cache. Then an atomic
//! rename swaps it into the place of the processed file. Bevy reports this change to the game like that of any other
//! asset.
//!
//! ```text
//! processor -> baker -> queue -> worker -> swap
//! ```

mod activity;
mod attempts;
mod baker;
mod events;
mod folders;
mod input;
mod journal;
mod lock;
mod names;
mod processor;
mod project;
mod queue;
mod readers;
mod request;
mod sources;
mod status;
mod swap;
mod timing;
mod watch;
mod worker;

use std::sync::Arc;
use std::thread::available_parallelism;
use std::time::Duration;

use bevy::asset::AssetPlugin;
use bevy::asset::io::file::FileAssetReader;
use bevy::asset::io::{AssetSourceBuilders, AssetSourceId};
use bevy::asset::processor::AssetProcessor;
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats, ImageLoader, ImagePlugin};
use bevy::prelude::*;
use simpliguard::settings::{self, BackendChoice, ProjectSettings};
use simpliguard_bake::{Processor, isolation};

pub use events::{BakeFailed, BakeFinished, BakeProgress, BakeStarted};
pub use processor::{MetaSettings, SimpliguardProcess};
pub use status::{BakeStatus, Bakes};

use crate::options::{BakeBackend, BakeMode, BakeOptions, BakePriority};
use attempts::Attempts;
use baker::Baker;
use events::{EventReceiver, deliver};
use folders::{Folders, Use};
use input::{Files, Input, InputLoader};
use journal::Journal;
use lock::{NoLog, ProcessorLock};
use project::Project;
use worker::Share;

/// Most work of a GPU in a frame of a game that does not wait for its bakes.
const GPU_TIME: Duration = Duration::from_millis(4);

/// The baker, whose queue is closed when the game ends.
#[derive(Resource)]
struct OpenBaker(Arc<Baker>);

impl Drop for OpenBaker {
    /// A game that panics for a reason of its own drops its resources on the way out.
    fn drop(&mut self) {
        self.0.attempts.end_all();
    }
}

/// Registers the asset sources, before `AssetPlugin` is built.
pub(crate) fn build(options: &BakeOptions, app: &mut App) {
    if isolation::is_child() {
        // This is not the game, but a bake of it.
        worker::serve(priority(options, &configured(options), mode(options, &configured(options))));
    }
    app.add_message::<BakeStarted>()
        .add_message::<BakeProgress>()
        .add_message::<BakeFinished>()
        .add_message::<BakeFailed>()
        .init_resource::<Bakes>();
    if app.is_plugin_added::<AssetPlugin>() {
        error!("SimpliguardPlugin must be added before DefaultPlugins (or AssetPlugin): no levels are baked");
        return;
    }
    let lock = ProcessorLock::take(&FileAssetReader::get_base_path());
    let folders = Folders::default();
    app.register_asset_source(project::SOURCE, Project::new(options.profile.clone()).source(lock.is_ours()));
    let mut sources = app.world_mut().get_resource_or_init::<AssetSourceBuilders>();
    match sources.get_mut(AssetSourceId::Default) {
        None => sources.insert(AssetSourceId::Default, folders.source(lock.is_ours())),
        // The game has registered a source of its own.
        Some(source) if !lock.is_ours() => source.processed_writer = None,
        Some(_) => {}
    }
    app.insert_resource(lock).insert_resource(folders);
}

/// Opens the asset sources and starts the workers, once all plugins are built.
pub(crate) fn finish(options: &BakeOptions, app: &mut App) {
    // A renderer overwrites it later.
    app.world_mut().get_resource_or_insert_with(|| CompressedImageFormatSupport(CompressedImageFormats::NONE));
    let Some(lock) = app.world_mut().remove_resource::<ProcessorLock>() else { return };
    let processor = app.world().get_resource::<AssetProcessor>().cloned();
    let usage = match &processor {
        None => Use::Plain,
        Some(_) if lock.is_ours() => Use::Process,
        Some(_) => Use::ReadProcessed,
    };
    let folders = app.world_mut().remove_resource::<Folders>().unwrap_or_default();
    let paths = paths(app);
    folders.open(&paths.source, &paths.processed, usage);
    match (processor, lock.refusal()) {
        (None, _) => info!(
            "no levels are baked: set `AssetPlugin {{ mode: AssetMode::Processed, .. }}` to bake them when models are imported"
        ),
        (Some(processor), Some(why)) => {
            warn!("assets are not processed and no levels are baked: {why}");
            if let Err(error) = processor.data().set_log_factory(Box::new(NoLog)) {
                error!("{error}");
            }
        }
        (Some(processor), None) => {
            app.insert_resource(lock);
            start(options, app, processor, &folders, &paths);
        }
    }
}

/// Starts the workers and registers the processor.
fn start(options: &BakeOptions, app: &mut App, processor: AssetProcessor, folders: &Folders, paths: &Paths) {
    warn_if_slow();
    let configured = configured(options);
    let (sender, receiver) = async_channel::unbounded();
    let mode = mode(options, &configured);
    let base = FileAssetReader::get_base_path();
    let journal = Journal::new(base.join(&paths.processed));
    journal.remove_stale_temporaries();
    if let Err(error) = sources::remove_stale(&journal) {
        warn!("sources of models that are gone take space: {error}");
    }
    let isolate = options.isolate.or(configured.isolate).unwrap_or(false);
    let baker = Arc::new(Baker {
        attempts: Attempts::new(journal.attempts()),
        mode,
        cache_dir: options.cache_dir.clone(),
        memory: options.memory.unwrap_or_else(simpliguard_bake::default_memory),
        isolate,
        journal,
        activity: folders.activity().clone(),
        project: Project::new(options.profile.clone()),
        queue: Arc::default(),
        events: sender,
        caches: default(),
        seen: default(),
    });
    match baker.journal.recover() {
        Ok(0) => {}
        Ok(count) => info!("{count} models are still to be baked"),
        Err(error) => warn!("save the models again whose bakes were interrupted: {error}"),
    }
    let files = Files { processor, root: base.join(&paths.source) };
    let share = Share {
        threads: threads(options, &configured, mode),
        priority: priority(options, &configured, mode),
        isolate,
        processor: processor_of(options, &configured, mode),
    };
    if let Err(error) = worker::start(&baker, &files, share) {
        error!("no levels are baked: cannot start the threads: {error}");
        return;
    }
    app.insert_resource(EventReceiver(receiver))
        .insert_resource(OpenBaker(baker.clone()))
        .add_systems(PreUpdate, deliver)
        .add_systems(Last, close_with_game)
        .init_asset::<Input>()
        .register_asset_loader(InputLoader { files })
        .register_asset_processor(SimpliguardProcess { baker });
    for extension in names::extensions(&base.join(&paths.source)) {
        app.set_default_asset_processor::<SimpliguardProcess>(&extension);
    }
}

/// Registers the loader of images if there is no renderer. Otherwise the loader would wait for ever for the renderer to
/// tell which formats there are.
pub(crate) fn cleanup(app: &mut App) {
    let formats = app.world().get_resource::<CompressedImageFormatSupport>().map(|support| support.0);
    if app.is_plugin_added::<ImagePlugin>() && formats == Some(CompressedImageFormats::NONE) {
        app.register_asset_loader(ImageLoader::new(CompressedImageFormats::NONE));
    }
}

/// The settings of the project. Errors in the file are reported with each model.
fn configured(options: &BakeOptions) -> ProjectSettings {
    Project::new(options.profile.clone()).read().map(|file| file.project).unwrap_or_default()
}

fn mode(options: &BakeOptions, configured: &ProjectSettings) -> BakeMode {
    options.mode.unwrap_or(match configured.mode.unwrap_or_default() {
        settings::BakeMode::Progressive => BakeMode::Progressive,
        settings::BakeMode::Blocking => BakeMode::Blocking,
    })
}

/// The priority of bakes. A game that waits for its bakes needs no time of its own.
fn priority(options: &BakeOptions, configured: &ProjectSettings, mode: BakeMode) -> BakePriority {
    options.priority.unwrap_or(match configured.priority {
        None if mode == BakeMode::Blocking => BakePriority::Normal,
        None => BakePriority::default(),
        Some(settings::BakePriority::Lowest) => BakePriority::Lowest,
        Some(settings::BakePriority::Low) => BakePriority::Low,
        Some(settings::BakePriority::Normal) => BakePriority::Normal,
    })
}

/// The number of threads that bake. One core is left to the game, unless it waits.
fn threads(options: &BakeOptions, configured: &ProjectSettings, mode: BakeMode) -> usize {
    let configured = configured.threads.map(|n| n.get() as usize);
    let cores = available_parallelism().map_or(1, |n| n.get());
    let free = if mode == BakeMode::Blocking { cores } else { cores - 1 };
    options.threads.or(configured).unwrap_or(free).max(1)
}

/// The processor that refines levels. A GPU is left to the game for most of each frame, unless it waits.
fn processor_of(options: &BakeOptions, configured: &ProjectSettings, mode: BakeMode) -> Processor {
    let chosen = options.backend.map(|backend| match backend {
        BakeBackend::Auto => BackendChoice::Auto,
        BakeBackend::Cpu => BackendChoice::Cpu,
        BakeBackend::Gpu => BackendChoice::Gpu,
    });
    let share = (mode == BakeMode::Progressive).then_some(GPU_TIME);
    Processor {
        backend: chosen.or(configured.backend).unwrap_or_default(),
        work_in_a_frame: options.gpu_time.or(configured.gpu_time).or(share),
    }
}

/// The folders of the default source, relative to the base of all asset folders.
struct Paths {
    source: String,
    processed: String,
}

fn paths(app: &App) -> Paths {
    let built_in = AssetPlugin::default();
    let plugin = app.get_added_plugins::<AssetPlugin>().first().copied().unwrap_or(&built_in);
    Paths { source: plugin.file_path.clone(), processed: plugin.processed_file_path.clone() }
}

fn warn_if_slow() {
    if matches!(simpliguard::OPT_LEVEL, "0" | "1") {
        warn!(
            "the baking code is compiled with opt-level {}: a bake takes many times as long; add the profile of the quick \
             start to Cargo.toml",
            simpliguard::OPT_LEVEL
        );
    }
}

fn close_with_game(mut exits: MessageReader<AppExit>, baker: Res<OpenBaker>) {
    if exits.read().next().is_some() {
        baker.0.queue.close();
        baker.0.attempts.end_all();
    }
}
