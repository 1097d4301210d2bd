//! The compressed primitives of a file, each geometry decoded once.

use std::collections::BTreeMap;

use bytes::Bytes;
use draco_core::DecodeLimits;

use super::geometry::{self, Geometry, WantedAttribute};
use crate::gltf::import::accessor::{Component, Reader};
use crate::gltf::import::asset::Asset;
use crate::gltf::import::schema::{DracoPrimitive, Primitive, Root};
use crate::{Error, StageId};

/// The name of the extension.
pub(super) const NAME: &str = "KHR_draco_mesh_compression";

pub(super) const TRIANGLES: u32 = 4;
pub(super) const TRIANGLE_STRIP: u32 = 5;

/// True if a file requires the extension.
pub(in crate::gltf::import) fn is_required(root: &Root<'_>) -> bool {
    root.extensions_required.contains(&NAME)
}

/// Decoded geometry, and the primitives that it belongs to.
pub(in crate::gltf::import) struct Decoded {
    /// The view of the compressed bytes.
    pub(super) view: usize,
    /// The accessor of the indices, if the primitives name one.
    pub(super) indices: Option<usize>,
    /// Name and accessor of each attribute of the geometry, in its order.
    pub(super) attributes: Vec<(String, usize)>,
    pub(super) geometry: Geometry,
    /// Mesh and primitive, each counted from 0.
    pub(super) places: Vec<(usize, usize)>,
}

/// Equal for primitives that share their geometry.
type Key<'a> = (usize, Option<usize>, Vec<(&'a str, usize, u32)>);

/// Decodes the compressed geometry of every mesh, each once.
///
/// # Errors
/// [`Error::Invalid`] if it cannot be decoded or is over the limits on triangles and bytes.
pub(in crate::gltf::import) fn decode(
    asset: Asset<'_>,
    root: &Root<'_>,
    buffers: &[Bytes],
) -> Result<Vec<Decoded>, Error> {
    let reader = Reader { asset, root, buffers };
    let mut keys: BTreeMap<Key<'_>, usize> = BTreeMap::new();
    let mut out: Vec<Decoded> = Vec::new();
    let mut bytes = 0u64;
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let Some(draco) = &primitive.extensions.draco else { continue };
            let is_triangles = matches!(primitive.mode.unwrap_or(TRIANGLES), TRIANGLES | TRIANGLE_STRIP);
            let key = key(primitive, draco);
            if !is_triangles || (!is_required(root) && has_plain_data(root, primitive, &key)) {
                continue;
            }
            if let Some(&known) = keys.get(&key) {
                out[known].places.push((m, p));
                continue;
            }
            asset.check()?;
            let geometry = geometry_of(reader, &key, asset.limits.bytes.saturating_sub(bytes))
                .map_err(|found| undecodable(asset, (m, p), &found))?;
            bytes = bytes.saturating_add(geometry.bytes());
            asset.allocate("its Draco geometry", geometry.bytes())?;
            let attributes = key.2.iter().map(|(name, accessor, _)| ((*name).to_owned(), *accessor)).collect();
            let (view, indices, places) = (draco.buffer_view, primitive.indices, vec![(m, p)]);
            keys.insert(key, out.len());
            out.push(Decoded { view, indices, attributes, geometry, places });
        }
    }
    Ok(out)
}

fn key<'a>(primitive: &Primitive<'a>, draco: &DracoPrimitive<'a>) -> Key<'a> {
    let accessor = |(&name, &id): (&&'a str, &u32)| Some((name, *primitive.attributes.get(name)?, id));
    (draco.buffer_view, primitive.indices, draco.attributes.iter().filter_map(accessor).collect())
}

/// True if every accessor of the geometry has bytes of its own.
fn has_plain_data(root: &Root<'_>, primitive: &Primitive<'_>, key: &Key<'_>) -> bool {
    let has_bytes = |accessor: usize| root.accessors.get(accessor).is_some_and(|a| a.buffer_view.is_some());
    primitive.indices.is_some_and(has_bytes) && key.2.iter().all(|(_, accessor, _)| has_bytes(*accessor))
}

/// Decodes one geometry to at most `most_bytes`. The error says what was found.
fn geometry_of(reader: Reader<'_>, key: &Key<'_>, most_bytes: u64) -> Result<Geometry, String> {
    let (view, _, attributes) = key;
    let wanted = attributes.iter().map(|(name, accessor, id)| {
        let accessor = reader.root.accessors.get(*accessor).ok_or_else(|| format!("{name} names no accessor"))?;
        let component = Component::of(accessor.component_type);
        let component = component.ok_or_else(|| format!("{name} has the unknown component type"))?;
        Ok(WantedAttribute { name, id: *id, component, normalized: accessor.normalized })
    });
    let wanted = wanted.collect::<Result<Vec<_>, String>>()?;
    let bytes = reader.view_bytes(*view).map_err(|_| format!("buffer view {view} goes past the end of its buffer"))?;
    let limits = DecodeLimits::default().with_max_faces(reader.asset.limits.triangles);
    geometry::decode(&bytes, &wanted, limits.with_max_decoded_bytes(most_bytes))
}

fn undecodable(asset: Asset<'_>, (mesh, primitive): (usize, usize), found: &str) -> Error {
    let found = format!("the Draco geometry of mesh {mesh}, primitive {primitive} cannot be decoded: {found}");
    Error::invalid(asset.name, StageId::Import, found, "export it again, or without Draco compression")
}
