//! Levels at import: an asset processor that never makes a game wait.
//!
//! Bevy gives every `.glb` and `.gltf` to [`SimpliguardProcess`]. What decides a bake - the model, the files it refers
//! to, its `.meta`, the project's settings and the version of the chain - is hashed to a key. If the cache has a result
//! for it, that is written as the processed asset. If not, the model itself is written, so that the game has it at once,
//! and a bake is queued. Its result goes to the cache and then, by an atomic rename, into the place of the processed
//! file, whose change Bevy reports to the game like that of any other asset.

mod baker;
mod events;
mod input;
mod journal;
mod names;
mod process;
mod project;
mod queue;
mod status;
mod worker;

use std::sync::Arc;
use std::thread::available_parallelism;

use bevy::asset::AssetPlugin;
use bevy::asset::io::file::FileAssetReader;
use bevy::asset::processor::AssetProcessor;
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats, ImageLoader, ImagePlugin};
use bevy::prelude::*;
use simpliguard::settings::ProjectSettings;

pub use events::{BakeFailed, BakeFinished, BakeProgress, BakeStarted};
pub use process::{MetaSettings, SimpliguardProcess};
pub use status::{BakeStatus, Bakes};

use crate::{BakeMode, SimpliguardPlugin};
use baker::Baker;
use events::{EventReceiver, deliver};
use input::{Input, InputLoader};
use journal::Journal;
use project::Project;
use queue::Queue;

/// Ends the bakes with the game.
#[derive(Resource)]
struct OpenQueue(Arc<Queue>);

/// What must be known before `AssetPlugin` is built.
pub(crate) fn build(plugin: &SimpliguardPlugin, app: &mut App) {
    app.add_message::<BakeStarted>()
        .add_message::<BakeProgress>()
        .add_message::<BakeFinished>()
        .add_message::<BakeFailed>()
        .init_resource::<Bakes>();
    if app.is_plugin_added::<AssetPlugin>() {
        error!("SimpliguardPlugin must be added before DefaultPlugins (or AssetPlugin): no levels are baked");
        return;
    }
    app.register_asset_source(project::SOURCE, Project::new(plugin.profile.clone()).source());
}

/// Everything else, once all plugins are built.
pub(crate) fn finish(plugin: &SimpliguardPlugin, app: &mut App) {
    // What a renderer puts over it comes later.
    app.world_mut().get_resource_or_insert_with(|| CompressedImageFormatSupport(CompressedImageFormats::NONE));
    let Some(processor) = app.world().get_resource::<AssetProcessor>().cloned() else {
        info!(
            "no levels are baked: set `AssetPlugin {{ mode: AssetMode::Processed, .. }}` to bake them when models are imported"
        );
        return;
    };
    if processor.get_source(project::SOURCE).is_err() {
        return;
    }
    warn_if_slow();
    let project = Project::new(plugin.profile.clone());
    // What is wrong with the file is reported with each model it is for.
    let configured = project.read().map(|file| file.project).unwrap_or_default();
    let (sender, receiver) = async_channel::unbounded();
    let baker = Arc::new(Baker {
        mode: mode(plugin, &configured),
        cache_dir: plugin.cache_dir.clone(),
        journal: journal(app),
        project,
        queue: Arc::default(),
        events: sender,
        caches: default(),
        seen: default(),
    });
    match baker.journal.recover() {
        Ok(0) => {}
        Ok(count) => info!("{count} models are still to be baked"),
        Err(error) => warn!("models whose bakes were interrupted have to be saved again: {error}"),
    }
    if let Err(error) = worker::start(&baker, &processor, threads(plugin, &configured)) {
        error!("no levels are baked: cannot start the threads: {error}");
        return;
    }
    app.insert_resource(EventReceiver(receiver))
        .insert_resource(OpenQueue(baker.queue.clone()))
        .add_systems(PreUpdate, (deliver, status::follow).chain())
        .add_systems(Last, close_with_game)
        .init_asset::<Input>()
        .register_asset_loader(InputLoader { processor })
        .register_asset_processor(SimpliguardProcess { baker });
    let folder = asset_folder(app);
    for extension in names::extensions(&folder) {
        app.set_default_asset_processor::<SimpliguardProcess>(&extension);
    }
}

/// Without a renderer nobody tells the loader of images which formats there are, and it would make models with images
/// wait for ever.
pub(crate) fn cleanup(app: &mut App) {
    let formats = app.world().get_resource::<CompressedImageFormatSupport>().map(|support| support.0);
    if app.is_plugin_added::<ImagePlugin>() && formats == Some(CompressedImageFormats::NONE) {
        app.register_asset_loader(ImageLoader::new(CompressedImageFormats::NONE));
    }
}

fn mode(plugin: &SimpliguardPlugin, configured: &ProjectSettings) -> BakeMode {
    plugin.mode.unwrap_or(match configured.mode.unwrap_or_default() {
        simpliguard::settings::BakeMode::Progressive => BakeMode::Progressive,
        simpliguard::settings::BakeMode::Blocking => BakeMode::Blocking,
    })
}

/// One core is the game's.
fn threads(plugin: &SimpliguardPlugin, configured: &ProjectSettings) -> usize {
    let configured = configured.threads.map(|n| n.get() as usize);
    let cores = available_parallelism().map_or(1, |n| n.get());
    plugin.threads.or(configured).unwrap_or(cores - 1).max(1)
}

fn journal(app: &App) -> Journal {
    let processed = app.get_added_plugins::<AssetPlugin>().first().map(|p| p.processed_file_path.clone());
    Journal::new(FileAssetReader::get_base_path().join(processed.unwrap_or_default()))
}

fn asset_folder(app: &App) -> std::path::PathBuf {
    let folder = app.get_added_plugins::<AssetPlugin>().first().map(|p| p.file_path.clone());
    FileAssetReader::get_base_path().join(folder.unwrap_or_default())
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

fn close_with_game(mut exits: MessageReader<AppExit>, queue: Res<OpenQueue>) {
    if exits.read().next().is_some() {
        queue.0.close();
    }
}
