//! glTF to [`Model`]: one surface in world space, its materials, textures and bones, and the file itself for the export.
//!
//! Follows glTF 2.0 and the extensions listed in `extensions.rs`. Files come from anywhere, so nothing is taken on
//! trust: the JSON is read by the schema of what is needed, every index and extent is checked where it is followed,
//! URIs stay inside the model's folder, and [`Limits`] are checked before memory is taken. A broken file gives an
//! [`Error`], never a panic.
//!
//! Limits: two sets of texture coordinates and one set of vertex colours per material; morph targets move positions
//! alone once they are weighted by a clip, texture coordinates and colours never.

mod accessor;
mod asset;
mod clean;
mod clips;
mod container;
mod extensions;
mod images;
mod material;
mod meshopt;
mod morphs;
mod nodes;
mod primitive;
mod resources;
mod rig;
mod schema;
mod surface;

#[cfg(test)]
mod tests;

use bytes::Bytes;
use serde_json::Value;

use self::accessor::Reader;
use self::asset::Asset;
use self::material::Materials;
use self::morphs::Driver;
use self::nodes::Tree;
use self::resources::{ExternalImage, Loader};
use self::rig::Skeleton;
use self::surface::{Assembly, MaterialSlots};
use crate::data::{Document, Model, Surface};
use crate::{Context, Error, Source};

pub use self::extensions::has_levels;

/// What a file may ask of the machine. Each is checked before the memory is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The file and everything it refers to, in bytes.
    pub bytes: u64,
    /// Values in the JSON.
    pub json_values: u64,
    /// glTF nodes.
    pub nodes: u64,
    /// Depth of the node tree.
    pub depth: u64,
    /// Triangles of the default scene over all instances.
    pub triangles: u64,
    /// Texels of all images in use.
    pub texels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            bytes: 2 << 30,
            json_values: 20_000_000,
            nodes: 200_000,
            depth: 512,
            triangles: 20_000_000,
            texels: 512 << 20,
        }
    }
}

/// Reads `source`. A file without triangles gives a model with an empty surface.
///
/// # Errors
/// [`Error::Invalid`] if it is no glTF or breaks its rules, [`Error::Resource`] if a buffer or a texture in use cannot be
/// read or decoded, [`Error::Extension`] if it requires an extension that is not understood, [`Error::Limit`] over one
/// of `limits`.
pub fn import(source: &Source<'_>, limits: &Limits) -> Result<Model, Error> {
    import_in(source, limits, &Context::default())
}

/// As [`import`], within a bake that may be cancelled.
pub(crate) fn import_in(source: &Source<'_>, limits: &Limits, context: &Context<'_>) -> Result<Model, Error> {
    let asset = Asset { name: source.name, limits, context };
    let container = container::parse(asset, source.bytes)?;
    let mut json = container.json;
    let mut loader = Loader::new(asset, source);
    let (buffers, external) = load(&mut loader, &mut json, container.bin)?;
    let root = asset.schema(&json)?;
    let reader = Reader { asset, root: &root, buffers: &buffers };

    let tree = Tree::of(asset, &root)?;
    let mesh_nodes = surface::mesh_nodes(reader, &tree)?;
    if !mesh_nodes.is_empty() {
        resources::check_complete(asset, &root, &buffers)?;
    }
    let skeleton = Skeleton::of(reader, &tree, &mesh_nodes)?;
    let driver = Driver::of(reader, &json, &mesh_nodes);
    let used = used_materials(reader, &mesh_nodes);
    let materials = material::read(asset, &root, &used)?;
    let slots = MaterialSlots::of(&used, &materials, root.materials.len());
    let (textures, assembly) = rayon::join(
        || images::decode(reader, &external, &materials.textures),
        || surface::assemble(reader, &tree, &mesh_nodes, &skeleton, &driver, &slots),
    );
    let (textures, mut assembly) = (textures?, assembly?);
    asset.check()?;
    let faces = assembly.surface.triangles.len();
    let dropped = clean::clean(&mut assembly.surface);
    dropped.check(asset, faces)?;
    trim_optional(&mut assembly.surface, &materials);

    let mut notes = notes(reader, &tree, &assembly, dropped);
    notes.extend(materials.notes);
    notes.extend(skeleton.notes);
    notes.extend(driver.notes);
    let used: Vec<usize> = used.into_iter().flatten().collect();
    notes.extend(extensions::dropped_material_extensions(&json, &used));
    notes.extend(external.iter().enumerate().filter_map(|(image, external)| match external {
        ExternalImage::Failed { uri, reason } => Some(format!("unused image {image} '{uri}' is left out: {reason}")),
        ExternalImage::InBuffer | ExternalImage::Read { .. } => None,
    }));
    let images = external.into_iter().map(|external| match external {
        ExternalImage::Read { bytes, mime, .. } => Some((bytes, mime)),
        ExternalImage::InBuffer | ExternalImage::Failed { .. } => None,
    });
    drop(root);
    Ok(Model {
        name: source.name.to_owned(),
        surface: assembly.surface,
        materials: materials.materials,
        textures,
        rig: skeleton.rig,
        document: Document { images: images.collect(), json, buffers, mesh_nodes, node_world: tree.world },
        notes,
    })
}

/// Reads what the JSON refers to. Compressed buffer views are decoded and `json` then describes the decoded ones.
fn load(
    loader: &mut Loader<'_>,
    json: &mut Value,
    bin: Option<Bytes>,
) -> Result<(Vec<Bytes>, Vec<ExternalImage>), Error> {
    let asset = loader.asset;
    let root = asset.schema(json)?;
    extensions::check_required(asset, &root.extensions_required)?;
    let mut buffers = loader.buffers(&root, bin)?;
    let images = loader.images(&root)?;
    if meshopt::is_used(&root) {
        meshopt::decode(asset, &root, &mut buffers)?;
        drop(root);
        meshopt::forget(json);
    }
    Ok((buffers, images))
}

/// The materials on triangles of the default scene, ascending, the default material last.
fn used_materials(reader: Reader<'_>, mesh_nodes: &[usize]) -> Vec<Option<usize>> {
    let meshes = mesh_nodes.iter().filter_map(|&node| reader.root.meshes.get(reader.root.nodes[node].mesh?));
    let primitives = meshes.flat_map(|mesh| &mesh.primitives).filter(|primitive| primitive::has_triangles(primitive));
    let mut used: Vec<Option<usize>> = primitives.map(|primitive| primitive.material).collect();
    used.sort_unstable_by_key(|material| (material.is_none(), *material));
    used.dedup();
    used
}

/// Empties the attributes that nothing uses.
fn trim_optional(surface: &mut Surface, materials: &Materials) {
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

/// What was left out of the surface, in words.
fn notes(reader: Reader<'_>, tree: &Tree, assembly: &Assembly, dropped: clean::Dropped) -> Vec<String> {
    let meshes = tree.nodes.iter().filter_map(|&node| reader.root.meshes.get(reader.root.nodes[node].mesh?));
    let left_out = meshes.flat_map(|mesh| &mesh.primitives).filter(|primitive| !primitive::has_triangles(primitive));
    let counts = [
        (dropped.not_finite, "faces with corners that are not finite are dropped"),
        (dropped.too_far, "faces with corners over 1e9 metres from the origin are dropped"),
        (dropped.degenerate, "degenerate faces are dropped"),
        (dropped.duplicate, "duplicate faces are dropped"),
        (assembly.stray_weights, "weights on joints that the skin does not have are dropped"),
        (left_out.count(), "primitives that are points, lines or without positions are left out of the levels"),
    ];
    let counted = counts.into_iter().filter(|(count, _)| *count > 0);
    counted.map(|(count, what)| format!("{count} {what}")).collect()
}
