//! The estimated cost of a bake, from the counts in a file. Nothing is decoded.
//!
//! The estimates decide only how models are put together into tasks, and which memory a worker must have. A wrong one
//! costs time, never a result.

use serde::Deserialize;
use simpliguard::settings::BakeSettings;
use simpliguard::{RelativeUri, Source};

use crate::images::size_of_image;

/// Length in bytes of a binary glTF's header, and of the header of each chunk.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// The counts that a bake's time depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Size {
    /// Triangles of all nodes with a mesh.
    pub(super) faces: u64,
    /// Texels of all images.
    pub(super) texels: u64,
}

/// The time and the memory of a bake on two cores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cost {
    /// In seconds.
    pub(super) seconds: f64,
    /// In bytes.
    pub(super) memory: u64,
}

impl Size {
    /// The counts of a source. What cannot be read counts for nothing: the bake itself will report it.
    pub(super) fn of(source: &Source<'_>) -> Self {
        let Some((json, binary)) = split(source.bytes) else { return Self::default() };
        let Ok(document) = serde_json::from_slice::<Document>(json) else { return Self::default() };
        let faces = document.faces();
        let texels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
        let sizes = document.images.iter().filter_map(|image| document.size_of(image, binary, source));
        Self { faces, texels: sizes.map(texels).fold(0, u64::saturating_add) }
    }
}

/// The JSON and the binary chunk of a file.
fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    if !bytes.starts_with(b"glTF") {
        return Some((bytes, &[]));
    }
    let length = u32::from_le_bytes(bytes.get(HEADER..HEADER + 4)?.try_into().ok()?) as usize;
    let (json, rest) = bytes.get(HEADER + CHUNK_HEADER..)?.split_at_checked(length)?;
    Some((json, rest.get(CHUNK_HEADER..).unwrap_or_default()))
}

#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
#[derive(Default)]
struct Document {
    nodes: Vec<Node>,
    meshes: Vec<Mesh>,
    accessors: Vec<Accessor>,
    images: Vec<Image>,
    buffer_views: Vec<BufferView>,
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<usize>,
}

#[derive(Deserialize)]
struct Mesh {
    #[serde(default)]
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    indices: Option<usize>,
    #[serde(default)]
    attributes: Attributes,
}

#[derive(Default, Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Deserialize)]
struct Accessor {
    #[serde(default)]
    count: u64,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Image {
    uri: Option<String>,
    buffer_view: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    #[serde(default)]
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    #[serde(default)]
    byte_length: usize,
}

impl Document {
    fn faces(&self) -> u64 {
        let count = |accessor: Option<usize>| Some(self.accessors.get(accessor?)?.count);
        let faces = |p: &Primitive| count(p.indices.or(p.attributes.position)).unwrap_or(0) / 3;
        let of_mesh = |mesh: &Mesh| mesh.primitives.iter().map(faces).fold(0, u64::saturating_add);
        let meshes: Vec<u64> = self.meshes.iter().map(of_mesh).collect();
        let used = self.nodes.iter().filter_map(|node| meshes.get(node.mesh?));
        used.copied().fold(0, u64::saturating_add)
    }

    fn size_of(&self, image: &Image, binary: &[u8], source: &Source<'_>) -> Option<[u32; 2]> {
        if let Some(view) = image.buffer_view {
            let view = self.buffer_views.get(view).filter(|view| view.buffer == 0)?;
            return size_of_image(binary.get(view.byte_offset..)?.get(..view.byte_length)?);
        }
        size_of_image(&source.resources.read(&RelativeUri::parse(image.uri.as_deref()?).ok()?).ok()?)
    }
}

/// The model of the time: a constant, and seconds for each triangle and texel, by a least squares fit to the bakes in
/// `docs/farm.md`. The constant holds what the settings decide: views, textures of the levels, refinement.
impl Cost {
    const SECONDS: f64 = 6.0;
    const SECONDS_PER_FACE: f64 = 8e-5;
    const SECONDS_PER_TEXEL: f64 = 2e-7;
    /// Seconds to read, check and write a model that is not baked.
    const SECONDS_PASSED: f64 = 0.1;
    const BYTES: u64 = 1 << 30;
    const BYTES_PER_FACE: u64 = 4096;
    const BYTES_PER_TEXEL: u64 = 32;

    /// The cost of a source with settings.
    pub(super) fn of(size: Size, settings: &BakeSettings) -> Self {
        let Size { faces, texels } = size;
        let most = settings.faces.iter().copied().max().unwrap_or(0);
        let passes = !settings.enabled || (settings.targets.is_empty() && faces <= u64::from(most));
        let sizes = [faces.saturating_mul(Self::BYTES_PER_FACE), texels.saturating_mul(Self::BYTES_PER_TEXEL)];
        Self {
            seconds: if passes {
                Self::SECONDS_PASSED
            } else {
                Self::SECONDS + Self::SECONDS_PER_FACE * faces as f64 + Self::SECONDS_PER_TEXEL * texels as f64
            },
            memory: sizes.into_iter().fold(Self::BYTES, u64::saturating_add),
        }
    }
}
