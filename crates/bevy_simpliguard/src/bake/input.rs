//! The input of a bake: a model and everything that decides its levels, read through Bevy.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bevy::asset::io::{AssetReaderError, AssetSourceId, Reader};
use bevy::asset::processor::AssetProcessor;
use bevy::asset::{Asset, AssetLoader, AssetPath, LoadContext};
use bevy::prelude::*;
use bytes::Bytes;
use simpliguard::gltf::external_uris;
use simpliguard::{RelativeUri, Resources, Source};

use super::activity::Stamp;
use super::names::is_model;
use super::project::Project;
use super::timing::PATIENCE;

/// Reads models and the files that they refer to as they are in their asset sources, before Bevy processes them.
#[derive(Clone)]
pub(super) struct Files {
    pub(super) processor: AssetProcessor,
    /// The folder of the default source.
    pub(super) root: PathBuf,
}

impl Files {
    /// Tells whether a file can be opened.
    pub(super) async fn exists(&self, path: &AssetPath<'static>) -> bool {
        let Ok(source) = self.processor.get_source(path.source().clone_owned()) else { return false };
        source.reader().read(path.path()).await.is_ok()
    }

    async fn read(&self, path: &AssetPath<'static>) -> Result<Bytes, String> {
        let explain = |e: AssetReaderError| match e {
            AssetReaderError::NotFound(_) => "there is no such file".to_owned(),
            e => e.to_string(),
        };
        let source = self.processor.get_source(path.source().clone_owned()).map_err(|e| e.to_string())?;
        let mut reader = source.reader().read(path.path()).await.map_err(explain)?;
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await.map_err(|e| e.to_string())?;
        Ok(bytes.into())
    }

    /// Tells versions of a file apart. `None` for files of other sources than the default one.
    fn stamp(&self, path: &AssetPath<'static>) -> Option<Stamp> {
        (*path.source() == AssetSourceId::Default).then(|| Stamp::of(&self.root.join(path.path())))
    }
}

/// The bytes of a model file and of the files it refers to.
#[derive(Clone, Debug, Default)]
pub(super) struct SourceFiles {
    /// For messages.
    name: String,
    bytes: Bytes,
    beside: BTreeMap<RelativeUri, Result<Bytes, String>>,
}

impl SourceFiles {
    /// Reads a model. If a file changes meanwhile, reads all files again, up to [`PATIENCE`].
    pub(super) async fn read(files: &Files, path: &AssetPath<'static>) -> Result<Self, String> {
        let start = Instant::now();
        loop {
            let mut stamps = vec![(path.clone(), files.stamp(path))];
            let bytes = files.read(path).await?;
            let name = path.to_string();
            let mut beside = BTreeMap::new();
            // A file that is no glTF refers to nothing. The bake will report its error.
            for uri in external_uris(&name, &bytes).unwrap_or_default() {
                let neighbour = neighbour(path, &uri);
                stamps.push((neighbour.clone(), files.stamp(&neighbour)));
                beside.insert(uri, files.read(&neighbour).await);
            }
            let is_one = stamps.iter().all(|(path, stamp)| files.stamp(path) == *stamp);
            if is_one || start.elapsed() > PATIENCE {
                return Ok(Self { name, bytes, beside });
            }
            debug!("{path}: its files change while they are read");
        }
    }

    /// The input of the pipeline.
    pub(super) fn source(&self) -> Source<'_> {
        Source { name: &self.name, bytes: &self.bytes, resources: self }
    }

    /// The files that the model at `path` refers to and that cannot be read.
    pub(super) fn missing(&self, path: &AssetPath<'static>) -> Vec<AssetPath<'static>> {
        let missing = self.beside.iter().filter(|(_, content)| content.is_err());
        missing.map(|(uri, _)| neighbour(path, uri)).collect()
    }

    /// The bytes of the model file.
    pub(super) fn bytes(&self) -> &Bytes {
        &self.bytes
    }
}

impl Resources for SourceFiles {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        self.beside.get(uri).cloned().unwrap_or_else(|| Err("it was not read".to_owned()))
    }
}

/// The asset that a URI in a model refers to.
fn neighbour(path: &AssetPath<'static>, uri: &RelativeUri) -> AssetPath<'static> {
    let folder = path.path().parent().unwrap_or(Path::new(""));
    AssetPath::from(folder.join(uri.as_str())).with_source(path.source().clone_owned())
}

/// Everything that [`super::processor::SimpliguardProcess`] needs of a model.
#[derive(Asset, TypePath, Debug)]
pub(super) struct Input {
    pub(super) files: SourceFiles,
    /// The text of the `.meta` file beside the model.
    pub(super) meta: Option<String>,
    /// The file of [`super::project`], or the reason why it cannot be read.
    pub(super) project: Result<Vec<u8>, String>,
}

/// Loads [`Input`] for the processor, never for a game: it has no extension. Errors in files other than the model are
/// part of the result.
#[derive(TypePath)]
pub(super) struct InputLoader {
    pub(super) files: Files,
}

impl AssetLoader for InputLoader {
    type Asset = Input;
    type Settings = ();
    type Error = std::io::Error;

    /// Loads the input. `Reader` is not used, because it may have been opened before the file was written again.
    async fn load(&self, _: &mut dyn Reader, (): &(), context: &mut LoadContext<'_>) -> std::io::Result<Input> {
        let path = context.path().clone();
        let files = SourceFiles::read(&self.files, &path).await.map_err(std::io::Error::other)?;
        // Reading a file through Bevy makes it a process dependency: when it changes, the model is processed again. Its
        // bytes are not used, because they may come from a processor of their own. Models are left out: two models that
        // refer to each other, or one that refers to itself, would wait for each other for ever.
        for uri in files.beside.keys().filter(|uri| !is_model(Path::new(uri.as_str()))) {
            if let Err(error) = context.read_asset_bytes(neighbour(&path, uri)).await {
                debug!("{path}: '{}' is not watched: {error}", uri.as_str());
            }
        }
        let project = context.read_asset_bytes(Project::asset()).await.map_err(|e| e.to_string());
        Ok(Input { files, meta: self.meta(&path).await, project })
    }

    fn extensions(&self) -> &[&str] {
        &[]
    }
}

impl InputLoader {
    async fn meta(&self, path: &AssetPath<'static>) -> Option<String> {
        let source = self.files.processor.get_source(path.source().clone_owned()).ok()?;
        let bytes = source.reader().read_meta_bytes(path.path()).await.ok()?;
        Some(String::from_utf8_lossy(&bytes).into_owned())
    }
}
