//! The import: glTF to [`Model`]. A model holds one surface in world space, its materials, textures and bones, and the
//! file itself for the export.
//!
//! It follows glTF 2.0 and the extensions listed in `extensions.rs`. Files come from anywhere, so nothing in them is
//! trusted: a schema reads the part of the JSON that is needed, every index and extent is checked where it is followed,
//! URIs stay inside the model's folder, and [`ImportLimits`] are checked before memory is allocated. A broken file
//! gives an [`Error`], never a panic.
//!
//! Compressed data is decoded first, and the JSON edited to match. So the rest of the import, and the export, see an
//! ordinary glTF that more loaders read.
//!
//! Levels of detail that a file comes with are no part of its surface.
//!
//! Limits: a material has two sets of texture coordinates and one set of vertex colours. Morph targets of the rest pose
//! move positions, normals and tangents; those that a clip weights move positions alone. No morph target changes
//! texture coordinates or colours.

mod accessor;
mod asset;
mod blocks;
mod clean;
mod clips;
mod container;
mod draco;
mod estimate;
mod extensions;
mod images;
mod influences;
mod instances;
mod ktx2;
mod limits;
mod material;
mod memory;
mod meshopt;
mod morphs;
mod nodes;
mod primitive;
mod primitive_mesh;
mod resources;
mod schema;
mod skeleton;
mod surface;
mod transcode;
mod webp;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use bytes::Bytes;
use serde_json::Value;

use self::accessor::Reader;
use self::asset::Asset;
use self::container::Container;
use self::material::{MaterialSlots, Materials};
use self::memory::Memory;
use self::morphs::Driver;
use self::nodes::Tree;
use self::resources::{Loader, SourceImage};
use self::skeleton::SourceSkeleton;
use self::surface::Assembler;
use crate::data::{Document, Model, Surface};
use crate::gltf::authored::level_nodes;
use crate::{Cancellation, Error, Source};

pub use self::limits::ImportLimits;

/// Reads `source`. A file without triangles gives a model with an empty surface.
///
/// # Errors
/// [`Error::Invalid`] if it is no glTF or breaks its rules, [`Error::Resource`] if a buffer or a texture in use cannot
/// be read or decoded, [`Error::Extension`] if it requires an extension that is not understood, [`Error::Limit`] over
/// one of `limits`, [`Error::Memory`] if it would take too much memory.
pub fn import(source: &Source<'_>, limits: &ImportLimits) -> Result<Model, Error> {
    import_in(source, limits, &Cancellation::default())
}

/// As [`import`], within a bake that may be cancelled.
pub(crate) fn import_in(
    source: &Source<'_>,
    limits: &ImportLimits,
    cancellation: &Cancellation,
) -> Result<Model, Error> {
    let memory = Memory::new(limits.memory);
    let asset = Asset { name: source.name, limits, cancellation, memory: &memory };
    let Loaded { json, buffers, images, decoded, block_bytes } = load(asset, source)?;
    let root = asset.schema(&json)?;
    let reader = Reader { asset, root: &root, buffers: &buffers };

    let tree = Tree::of(asset, &root)?;
    let mesh_nodes = surface::mesh_nodes(reader, &tree, &level_nodes(all_nodes(&json)))?;
    if !mesh_nodes.is_empty() {
        resources::check_complete(asset, &root, &buffers)?;
    }
    estimate::check_surface(reader, &mesh_nodes)?;
    let skeleton = SourceSkeleton::of(reader, &tree, &mesh_nodes)?;
    let driver = Driver::of(reader, &json, &mesh_nodes);
    let used = surface::used_materials(reader, &mesh_nodes);
    let materials = material::read(asset, &root, &used)?;
    let slots = MaterialSlots::of(&used, &materials, root.materials.len());
    let assembler = Assembler { reader, tree: &tree, skeleton: &skeleton, driver: &driver, materials: &slots };
    let encoded = images::find(reader, &images, &materials.textures)?;
    let (textures, assembly) =
        rayon::join(|| images::decode(reader, &encoded, &materials.textures), || assembler.assemble(&mesh_nodes));
    let (textures, mut assembly) = (textures?, assembly?);
    asset.check()?;
    let dropped = clean::clean(asset, &mut assembly.surface)?;
    clear_unused_uvs(&mut assembly.surface, &materials);

    let used: Vec<usize> = used.into_iter().flatten().collect();
    let notes = [
        dropped.notes(),
        assembly.notes(),
        surface::skipped_primitives(reader, &tree),
        materials.notes,
        skeleton.notes,
        driver.notes,
        extensions::dropped_material_extensions(&json, &used),
        resources::unread_images(&images),
    ];
    drop(root);
    let images = images.into_iter().map(SourceImage::into_bytes).collect();
    Ok(Model {
        name: source.name.to_owned(),
        surface: assembly.surface,
        materials: materials.materials,
        textures,
        rig: skeleton.rig,
        document: Document { images, json, buffers, decoded, block_bytes, mesh_nodes, node_world: tree.world },
        notes: notes.concat(),
    })
}

/// Reads a file without its geometry, for the split into objects. The import of each object checks what this does not.
///
/// # Errors
/// As [`import`], but for accessors, materials and images.
pub(in crate::gltf) fn read_document(
    source: &Source<'_>,
    limits: &ImportLimits,
    cancellation: &Cancellation,
) -> Result<Document, Error> {
    let memory = Memory::new(limits.memory);
    // Each object has as many triangles as a file may have.
    let limits = ImportLimits { triangles: u64::MAX, ..*limits };
    let asset = Asset { name: source.name, limits: &limits, cancellation, memory: &memory };
    let Loaded { json, buffers, images, decoded, block_bytes } = load(asset, source)?;
    let root = asset.schema(&json)?;
    let reader = Reader { asset, root: &root, buffers: &buffers };
    let tree = Tree::of(asset, &root)?;
    let mesh_nodes = surface::mesh_nodes(reader, &tree, &level_nodes(all_nodes(&json)))?;
    resources::check_complete(asset, &root, &buffers)?;
    drop(root);
    let images = images.into_iter().map(SourceImage::into_bytes).collect();
    Ok(Document { images, json, buffers, decoded, block_bytes, mesh_nodes, node_world: tree.world })
}

fn all_nodes(json: &Value) -> &[Value] {
    json.get("nodes").and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// A file and all bytes that it refers to.
struct Loaded {
    json: Value,
    buffers: Vec<Bytes>,
    images: Vec<SourceImage>,
    /// True if the file has data that was decoded.
    decoded: bool,
    /// Bytes on the GPU of the images that were in blocks.
    block_bytes: BTreeMap<usize, u64>,
}

/// Reads the JSON and the files it refers to. Compressed buffer views, geometry, KTX2 and WebP images and images in blocks
/// are decoded; the JSON then describes the decoded ones.
fn load(asset: Asset<'_>, source: &Source<'_>) -> Result<Loaded, Error> {
    let Container { mut json, bin } = container::parse(asset, source.bytes)?;
    let mut loader = Loader::new(asset, source);
    let root = asset.schema(&json)?;
    extensions::check_required(asset, &root.extensions_required)?;
    let mut buffers = loader.buffers(&root, bin)?;
    let mut images = loader.images(&root)?;
    let has_meshopt = meshopt::is_declared(&root);
    if has_meshopt {
        meshopt::decode(asset, &root, &mut buffers)?;
    }
    let geometry = draco::decode(asset, &root, &buffers)?;
    let reader = Reader { asset, root: &root, buffers: &buffers };
    let pngs = transcode::decode(reader, &images)?;
    let in_blocks = blocks::decode(reader, &json)?;
    let has_draco = draco::is_required(&root) || !geometry.is_empty();
    let has_pngs = transcode::is_used(&root) || !pngs.is_empty();
    drop(root);
    if has_meshopt {
        meshopt::remove_extension(&mut json);
    }
    if has_draco {
        draco::replace(&mut json, &mut buffers, &geometry);
    }
    if has_pngs {
        transcode::remove_extensions(&mut json);
        transcode::replace(&mut json, &mut buffers, &mut images, pngs);
    }
    let block_bytes = blocks::replace(&mut json, &mut buffers, in_blocks);
    let decoded = has_meshopt || has_draco || has_pngs || !block_bytes.is_empty();
    Ok(Loaded { json, buffers, images, decoded, block_bytes })
}

/// Empties the second set of texture coordinates if no material uses it.
fn clear_unused_uvs(surface: &mut Surface, materials: &Materials) {
    let second_used = materials.materials.iter().any(|material| {
        let slots = [
            material.base_color_texture,
            material.metallic_roughness_texture,
            material.normal_texture,
            material.occlusion_texture,
            material.emissive_texture,
        ];
        slots.iter().flatten().any(|texture| texture.uv_set == 1)
    });
    if !second_used {
        surface.uvs[1] = Vec::new();
    }
}
