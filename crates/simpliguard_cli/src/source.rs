//! Model files on disk.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use bytes::Bytes;
use simpliguard::{Error, RelativeUri, Resources, Source, StageId};
use simpliguard_cache::read_bounded;

use crate::boundary::Boundary;

/// Largest size in bytes of a file that is read. It is also the largest length in a binary glTF.
const MAX_FILE_BYTES: u64 = u32::MAX as u64;

/// Largest size in bytes of a file of settings.
const MAX_TEXT_BYTES: u64 = 16 << 20;

/// A model file in memory. The files beside it are read when they are asked for.
pub(crate) struct SourceFile {
    name: String,
    bytes: Bytes,
    folder: Folder,
}

impl SourceFile {
    /// Reads a `.glb` or `.gltf` file. `name` is for messages. The model may refer to files in its folder and, through links,
    /// to files in `project`.
    pub(crate) fn read(path: &Path, name: &str, project: Option<&Path>) -> Result<Self, Error> {
        let invalid = |found: String, advice| Error::invalid(name, StageId::Import, found, advice);
        if !is_gltf(path) {
            return Err(invalid("its name does not end in .glb or .gltf".into(), "convert it to glTF first"));
        }
        let bytes =
            read(path).map_err(|reason| invalid(format!("cannot read the file: {reason}"), "check the path"))?;
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        let mut boundary = Boundary::of(&folder, project);
        // A model that is itself a link brings its own folder.
        boundary.extend(path.canonicalize().ok().as_deref().and_then(Path::parent));
        let folder = Folder { path: folder, boundary, seen: Mutex::default() };
        Ok(Self { name: name.to_owned(), bytes, folder })
    }

    /// The files beside the model that were read so far, by their paths in its folder.
    pub(crate) fn files_beside(&self) -> Vec<PathBuf> {
        let seen = self.folder.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let read = seen.iter().filter(|(_, read)| read.is_ok());
        read.map(|(uri, _)| self.folder.path.join(uri.as_str())).collect()
    }

    /// The input of a bake. Each file is read once, so the bytes of the key are the bytes that are baked.
    pub(crate) fn source(&self) -> Source<'_> {
        Source { name: &self.name, bytes: &self.bytes, resources: &self.folder }
    }
}

/// The files beside a model. Each is kept after the first read.
struct Folder {
    path: PathBuf,
    boundary: Boundary,
    seen: Mutex<BTreeMap<RelativeUri, Result<Bytes, String>>>,
}

impl Folder {
    fn read_inside(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        let path = self.path.join(uri.as_str()).canonicalize().map_err(|e| explain(&e))?;
        if self.boundary.holds(&path) {
            read(&path)
        } else {
            Err("a link leads out of the model's folder and its project".into())
        }
    }
}

impl Resources for Folder {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.entry(uri.clone()).or_insert_with(|| self.read_inside(uri)).clone()
    }
}

fn read(path: &Path) -> Result<Bytes, String> {
    read_bounded(path, MAX_FILE_BYTES).map(Bytes::from).map_err(|e| explain(&e))
}

fn explain(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file".to_owned(),
        _ => error.to_string(),
    }
}

/// The text of a file of settings.
pub(crate) fn read_text(path: &Path) -> io::Result<String> {
    let bytes = read_bounded(path, MAX_TEXT_BYTES)?;
    String::from_utf8(bytes).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "it is no UTF-8 text"))
}

/// Tells whether a file is a model, by its name.
pub(crate) fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
}

/// A path for messages: relative to the current folder if it lies below, with `/` between its parts.
pub(crate) fn shown(path: &Path) -> String {
    let current = std::env::current_dir().unwrap_or_default();
    slashed(path.strip_prefix(current).unwrap_or(path))
}

/// A path with `/` between its parts.
pub(crate) fn slashed(path: &Path) -> String {
    let text = path.to_string_lossy();
    if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() }
}
