//! What a child is asked to bake: one line of JSON and the bytes of the files behind it, on its standard input.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Read, Write};
use std::path::PathBuf;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use simpliguard::gltf::external_uris;
use simpliguard::settings::BakeSettings;
use simpliguard::{RelativeUri, Resources, Source};
use simpliguard_cache::Cache;

use crate::device::Processor;

/// The parts of a result that a child makes.
#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) enum Wanted {
    Combined,
    Levels,
    Sheet,
}

/// A bake but for the bytes of its files.
#[derive(Serialize, Deserialize)]
pub(super) struct Header {
    pub(super) name: String,
    /// As RON.
    settings: String,
    pub(super) wanted: Wanted,
    pub(super) preview: bool,
    /// Bytes that the bake may take.
    pub(super) memory: Option<u64>,
    pub(super) processor: Processor,
    pub(super) threads: usize,
    /// Folder for the parts of the result.
    pub(super) folder: PathBuf,
    /// Folder and largest size of the cache of stages and objects.
    cache: Option<(PathBuf, u64)>,
    /// Length of the model.
    model: usize,
    /// The files beside the model: their lengths, or why they cannot be read.
    files: Vec<(String, Result<usize, String>)>,
}

/// What the program around a bake decides.
pub(super) struct Terms {
    pub(super) wanted: Wanted,
    pub(super) preview: bool,
    pub(super) memory: Option<u64>,
    pub(super) processor: Processor,
    pub(super) threads: usize,
    pub(super) folder: PathBuf,
}

/// A request as the child has it.
pub(super) struct Request {
    pub(super) header: Header,
    pub(super) settings: BakeSettings,
    model: Bytes,
    files: Files,
}

/// The files beside a model.
struct Files(BTreeMap<String, Result<Bytes, String>>);

impl Resources for Files {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        self.0.get(uri.as_str()).cloned().unwrap_or_else(|| Err("the model does not name it".to_owned()))
    }
}

/// Writes a request.
pub(super) fn write(
    out: &mut impl Write,
    source: &Source<'_>,
    settings: &BakeSettings,
    cache: Option<&Cache>,
    terms: Terms,
) -> io::Result<()> {
    let uris = external_uris(source.name, source.bytes).unwrap_or_default();
    let files: Vec<_> = uris.iter().map(|uri| (uri.as_str(), source.resources.read(uri))).collect();
    let length = |(uri, read): &(&str, Result<Bytes, String>)| {
        ((*uri).to_owned(), read.as_ref().map(Bytes::len).map_err(Clone::clone))
    };
    let Terms { wanted, preview, memory, processor, threads, folder } = terms;
    let header = Header {
        name: source.name.to_owned(),
        settings: settings.to_ron(),
        wanted,
        preview,
        memory,
        processor,
        threads,
        folder,
        cache: cache.map(|cache| (cache.root().to_owned(), cache.max_size())),
        model: source.bytes.len(),
        files: files.iter().map(length).collect(),
    };
    writeln!(out, "{}", serde_json::to_string(&header)?)?;
    out.write_all(source.bytes)?;
    files.iter().filter_map(|(_, read)| read.as_ref().ok()).try_for_each(|bytes| out.write_all(bytes))?;
    out.flush()
}

impl Request {
    /// Reads a request.
    pub(super) fn read(input: &mut impl BufRead) -> io::Result<Self> {
        let mut line = String::new();
        input.read_line(&mut line)?;
        let mut header: Header = serde_json::from_str(&line)?;
        let settings = BakeSettings::from_ron(&header.settings).map_err(io::Error::other)?;
        let model = exactly(input, header.model)?;
        let mut files = BTreeMap::new();
        for (uri, length) in std::mem::take(&mut header.files) {
            let read = match length {
                Ok(length) => Ok(exactly(input, length)?),
                Err(reason) => Err(reason),
            };
            files.insert(uri, read);
        }
        Ok(Self { header, settings, model, files: Files(files) })
    }

    /// The input of the bake.
    pub(super) fn source(&self) -> Source<'_> {
        Source { name: &self.header.name, bytes: &self.model, resources: &self.files }
    }

    /// The cache of stages and objects.
    pub(super) fn cache(&self) -> Option<Cache> {
        self.header.cache.as_ref().map(|(root, max_size)| Cache::new(root).with_max_size(*max_size))
    }
}

fn exactly(input: &mut impl BufRead, length: usize) -> io::Result<Bytes> {
    let mut bytes = Vec::with_capacity(length);
    input.take(length as u64).read_to_end(&mut bytes)?;
    if bytes.len() == length { Ok(bytes.into()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}
