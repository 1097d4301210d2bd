//! The asset source of the files with sources: a folder beside that of the models, without a processor.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use bevy::asset::io::{
    AssetReader, AssetReaderError, AssetSource, AssetSourceBuilder, AssetSourceBuilders, AssetSourceId,
    ErasedAssetReader, PathStream, Reader,
};
use bevy::asset::{AssetMode, AssetPlugin};
use bevy::prelude::*;

/// The name of the asset source with the sources that are loaded on demand, and of its folder: `imported_assets/on_demand`.
pub const SOURCE: &str = "on_demand";

/// The folder, once `AssetPlugin` tells where it is.
#[derive(Resource, Clone, Default)]
struct Folder(Arc<OnceLock<Box<dyn ErasedAssetReader>>>);

/// Registers the asset source, unless the game has one of its own. It has to happen before `AssetPlugin` is built.
pub(in crate::lod) fn register(app: &mut App) {
    if app.is_plugin_added::<AssetPlugin>() || app.world().contains_resource::<Folder>() {
        return;
    }
    let mut sources = app.world_mut().get_resource_or_init::<AssetSourceBuilders>();
    if sources.get_mut(AssetSourceId::from(SOURCE)).is_some() {
        return;
    }
    let folder = Folder::default();
    let (plain, processed) = (folder.clone(), folder.clone());
    // Without a writer of processed files, Bevy's processor leaves the source alone.
    let source = AssetSourceBuilder::new(move || Box::new(plain.clone()))
        .with_processed_reader(move || Box::new(processed.clone()));
    sources.insert(SOURCE, source);
    app.insert_resource(folder);
}

/// Opens the folder, beside the one that models are loaded from.
pub(in crate::lod) fn open(app: &mut App) {
    let Some(Folder(folder)) = app.world_mut().remove_resource::<Folder>() else { return };
    let built_in = AssetPlugin::default();
    let plugin = app.get_added_plugins::<AssetPlugin>().first().copied().unwrap_or(&built_in);
    let models = match plugin.mode {
        AssetMode::Processed => &plugin.processed_file_path,
        AssetMode::Unprocessed => &plugin.file_path,
    };
    let path = Path::new(models).parent().unwrap_or(Path::new("")).join(SOURCE);
    folder.get_or_init(AssetSource::get_default_reader(path.to_string_lossy().into_owned()));
}

impl Folder {
    fn reader(&self, path: &Path) -> Result<&dyn ErasedAssetReader, AssetReaderError> {
        self.0.get().map(AsRef::as_ref).ok_or_else(|| AssetReaderError::NotFound(path.to_owned()))
    }
}

impl AssetReader for Folder {
    async fn read<'a>(&'a self, path: &'a Path) -> Result<impl Reader + 'a, AssetReaderError> {
        self.reader(path)?.read(path).await
    }

    async fn read_meta<'a>(&'a self, path: &'a Path) -> Result<impl Reader + 'a, AssetReaderError> {
        self.reader(path)?.read_meta(path).await
    }

    async fn read_directory<'a>(&'a self, path: &'a Path) -> Result<Box<PathStream>, AssetReaderError> {
        self.reader(path)?.read_directory(path).await
    }

    async fn is_directory<'a>(&'a self, path: &'a Path) -> Result<bool, AssetReaderError> {
        self.reader(path)?.is_directory(path).await
    }
}
