//! The source file as it was read.

use std::collections::BTreeMap;

use bytes::Bytes;
use glam::Mat4;

/// The source glTF itself: its JSON, and every byte that the JSON refers to, read and checked.
#[derive(Clone, Debug, Default)]
pub struct Document {
    /// The JSON of the file. Compressed buffer views, geometry, KTX2 and WebP images and images in blocks are
    /// replaced by the decoded ones.
    pub json: serde_json::Value,
    /// One entry per glTF buffer, at least `byteLength` long.
    pub buffers: Vec<Bytes>,
    /// One entry per glTF image: the encoded bytes and the MIME type of an image given by URI. `None` for an image in a
    /// buffer view, and for one that could not be read.
    pub images: Vec<Option<(Bytes, &'static str)>>,
    /// True if the file has data that was decoded, which few loaders read.
    pub decoded: bool,
    /// Bytes on the GPU, with mipmaps, of the images that were in blocks.
    pub block_bytes: BTreeMap<usize, u64>,
    /// Nodes of the default scene that carry triangles, ascending. The levels replace them.
    pub mesh_nodes: Vec<usize>,
    /// World matrix of each node in the rest pose, indexed as `nodes`; identity for nodes outside the default scene.
    pub node_world: Vec<Mat4>,
}
