//! The estimated cost of a bake, from the counts in a file. Nothing is decoded.
//!
//! The estimates decide only how models are put together into tasks, and which memory a worker must have. A wrong one
//! costs time, never a result.

use serde::Deserialize;
use simpliguard::settings::{BakeSettings, Quality};
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

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
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

impl Cost {
    /// Seconds of a bake without triangles, and for each triangle: lines through the times of models of 37,000 and 95,000
    /// triangles in `docs/results.md`. Larger models take less than these lines say.
    fn line(quality: Quality) -> (f64, f64) {
        match quality {
            Quality::Draft => (0.8, 6.0e-5),
            Quality::Standard => (7.8, 1.28e-4),
            Quality::Best => (14.6, 1.67e-4),
        }
    }

    /// Seconds to decode a texel of a PNG. It is assumed: no table has it.
    const SECONDS_PER_TEXEL: f64 = 3e-8;
    /// Seconds to read, check and write a model that is not baked.
    const SECONDS_PASSED: f64 = 0.1;
    /// Bytes of a bake without triangles and textures, and for each triangle, above those that `docs/results.md` has measured.
    const BYTES: u64 = 768 << 20;
    const BYTES_PER_FACE: u64 = 512;
    /// Bytes of a decoded texel, with those of its conversion. They are assumed.
    const BYTES_PER_TEXEL: u64 = 16;

    /// The cost of a source with settings.
    pub(super) fn of(size: Size, settings: &BakeSettings) -> Self {
        let Size { faces, texels } = size;
        let most = settings.faces.iter().copied().max().unwrap_or(0);
        let passes = !settings.enabled || (settings.targets.is_empty() && faces <= u64::from(most));
        let (constant, per_face) = Self::line(settings.quality);
        let baked = constant + per_face * faces as f64;
        let sizes = [faces.saturating_mul(Self::BYTES_PER_FACE), texels.saturating_mul(Self::BYTES_PER_TEXEL)];
        Self {
            seconds: if passes { Self::SECONDS_PASSED } else { baked } + Self::SECONDS_PER_TEXEL * texels as f64,
            memory: sizes.into_iter().fold(Self::BYTES, u64::saturating_add),
        }
    }
}

#[cfg(test)]
mod tests {
    use simpliguard::NoResources;

    use super::*;

    fn size(json: &str) -> Size {
        Size::of(&Source { name: "a.gltf", bytes: json.as_bytes(), resources: &NoResources })
    }

    #[test]
    fn triangles_are_counted_for_each_node() {
        let json = r#"{"nodes": [{"mesh": 0}, {"mesh": 0}, {}, {"mesh": 9}],
            "meshes": [{"primitives": [{"indices": 1, "attributes": {"POSITION": 0}}, {"attributes": {"POSITION": 0}}]}],
            "accessors": [{"count": 6}, {"count": 30}], "images": [{"uri": "../secret.png"}, {"bufferView": 7}]}"#;
        assert_eq!(size(json), Size { faces: 24, texels: 0 });
    }

    #[test]
    fn what_cannot_be_read_counts_for_nothing() {
        for json in ["", "{", "[]", "glTF", r#"{"nodes": [{"mesh": -1}]}"#] {
            assert_eq!(size(json), Size::default(), "{json}");
        }
        let huge = r#"{"nodes": [{"mesh": 0}, {"mesh": 0}], "accessors": [{"count": 18446744073709551615}],
            "meshes": [{"primitives": [{"indices": 0}, {"indices": 0}]}]}"#;
        assert_eq!(size(huge).faces, u64::MAX);
    }

    #[test]
    fn larger_models_and_better_quality_cost_more() {
        let cost = |faces, quality| Cost::of(Size { faces, texels: 1 << 20 }, &BakeSettings::preset(quality));
        let [draft, standard, best] =
            [Quality::Draft, Quality::Standard, Quality::Best].map(|quality| cost(95_000, quality).seconds);
        assert!(draft < standard && standard < best && (19.0..22.0).contains(&standard), "{standard}");
        assert!(cost(10, Quality::Standard).seconds < 0.2, "it is small enough");
        assert!(cost(1_000_000, Quality::Best).memory > cost(95_000, Quality::Best).memory);
        assert_eq!(cost(u64::MAX, Quality::Best).memory, u64::MAX);
    }
}
