//! What a file says of its source on demand, in `extras` of its asset.

use bevy::asset::{AssetPath, LoadContext};
use bevy::gltf::GltfAssetLabel;
use bevy::prelude::*;
use gltf::json::deserialize;
use serde::Deserialize;

use super::asset_source::SOURCE;
use super::components::OnDemandSource;

#[derive(Deserialize)]
struct Extras {
    simpliguard: Stamp,
}

#[derive(Deserialize)]
struct Stamp {
    source: Option<SourceStamp>,
    /// The part that a file has, if it is not the levels.
    part: Option<Part>,
}

#[derive(Clone, Debug, Deserialize)]
struct SourceStamp {
    /// The name of the file with the source.
    file: String,
    /// Bytes on the GPU.
    bytes: u64,
    meshes: Vec<usize>,
    textures: Vec<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Part {
    Source,
}

/// The source on demand of a file with levels.
#[derive(Clone, Debug)]
pub(in crate::lod) struct SourceOfFile {
    stamp: SourceStamp,
    /// The nodes that show it.
    nodes: Vec<usize>,
    /// The labels of its meshes.
    meshes: Vec<String>,
}

fn stamp(document: &gltf::Document) -> Option<Stamp> {
    let extras = document.as_json().asset.extras.as_ref()?;
    Some(deserialize::from_str::<Extras>(extras.get()).ok()?.simpliguard)
}

/// Tells whether a file has a source alone, whose levels are in another file.
pub(in crate::lod) fn is_source(document: &gltf::Document) -> bool {
    stamp(document).is_some_and(|stamp| stamp.part.is_some())
}

impl SourceOfFile {
    /// The source on demand of a file. `None` if it has none.
    pub(in crate::lod) fn of(document: &gltf::Document) -> Option<Self> {
        let stamp = stamp(document)?.source?;
        let is_own = |mesh: &gltf::Mesh<'_>| stamp.meshes.contains(&mesh.index());
        let shows = |node: &gltf::Node<'_>| node.mesh().is_some_and(|mesh| is_own(&mesh));
        let nodes = document.nodes().filter(shows).map(|node| node.index()).collect();
        let labels = |mesh: gltf::Mesh<'_>| {
            let label = |primitive| GltfAssetLabel::Primitive { mesh: mesh.index(), primitive }.to_string();
            (0..mesh.primitives().len()).map(label).collect::<Vec<_>>()
        };
        let meshes: Vec<String> = document.meshes().filter(is_own).flat_map(labels).collect();
        (!meshes.is_empty()).then_some(Self { stamp, nodes, meshes })
    }

    /// Tells whether a scene shows the source.
    pub(in crate::lod) fn is_in(&self, has_node: impl Fn(&usize) -> bool) -> bool {
        self.nodes.iter().any(has_node)
    }

    /// The component of a scene that shows the source.
    pub(in crate::lod) fn component(
        &self,
        context: &mut LoadContext<'_>,
        rotate_meshes: bool,
        always: bool,
    ) -> OnDemandSource {
        let path = context.path().path().join(&self.stamp.file);
        let file = AssetPath::from(path).with_source(SOURCE).to_string();
        let meshes = self.meshes.iter().map(|label| context.get_label_handle(label.clone())).collect();
        let texture = |&texture: &usize| context.get_label_handle(GltfAssetLabel::Texture(texture).to_string());
        let textures = self.stamp.textures.iter().map(texture).collect();
        OnDemandSource { file, bytes: self.stamp.bytes, meshes, textures, rotate_meshes, always }
    }
}
