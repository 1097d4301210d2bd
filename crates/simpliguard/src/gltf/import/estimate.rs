//! Upper bounds on the memory of a surface, from the counts in a file alone.

use std::collections::BTreeSet;

use super::accessor::Reader;
use super::instances::instance_count;
use super::primitive;
use super::schema::Primitive;
use crate::Error;

/// Bytes that the later stages take for each triangle: search trees, views' buffers, meshes on their way to a budget.
const STAGES_PER_TRIANGLE: u64 = 800;
/// Bytes of a vertex of the surface with all attributes.
const SURFACE_VERTEX: u64 = 120;
/// Bytes of a triangle of the surface.
const SURFACE_TRIANGLE: u64 = 16;
/// Bytes of the transform of an instance, and of the numbers it is made of.
const INSTANCE: u64 = 112;
/// Bytes of the largest attribute of a vertex, and of the copy that is converted.
const ATTRIBUTE: u64 = 32;
/// Bytes of a displacement by a morph target: as read, and with the number of its vertex on the surface.
const DISPLACEMENT: u64 = 28;
/// Bytes of an element that a sparse accessor replaces.
const SPARSE: u64 = 24;

/// Counts what the surface of `mesh_nodes` takes.
///
/// # Errors
/// [`Error::Memory`] if that is over the budget.
pub(super) fn check_surface(reader: Reader<'_>, mesh_nodes: &[usize]) -> Result<(), Error> {
    let (mut kept, mut while_read, mut triangles) = (0u64, 0u64, 0u64);
    let mut seen = BTreeSet::new();
    for &index in mesh_nodes {
        let node = &reader.root.nodes[index];
        let Some(mesh) = node.mesh.and_then(|mesh| Some((mesh, reader.root.meshes.get(mesh)?))) else { continue };
        let instances = instance_count(reader, node)? as u64;
        kept = kept.saturating_add(instances.saturating_mul(INSTANCE));
        let is_new = seen.insert(mesh.0);
        for primitive in mesh.1.primitives.iter().filter(|primitive| primitive::has_triangles(primitive)) {
            let size = Size::of(reader, primitive)?;
            let copies = size.used * SURFACE_VERTEX + size.triangles * SURFACE_TRIANGLE;
            kept = kept.saturating_add(copies.saturating_mul(instances));
            triangles = triangles.saturating_add(size.triangles.saturating_mul(instances));
            if is_new {
                while_read = while_read.max(size.while_read);
            }
        }
    }
    // A list that grows is copied: for a moment, it is there twice.
    let import = kept.saturating_mul(2).saturating_add(while_read);
    reader.asset.allocate("its surface", import)?;
    reader.asset.fits("the bake of its triangles", triangles.saturating_mul(STAGES_PER_TRIANGLE))
}

/// The size of a primitive, from its counts.
struct Size {
    /// Number of vertices that triangles use, at most.
    used: u64,
    triangles: u64,
    /// Bytes while it is read.
    while_read: u64,
}

impl Size {
    fn of(reader: Reader<'_>, primitive: &Primitive<'_>) -> Result<Self, Error> {
        let count = |name: &str| primitive.attributes.get(name).map_or(Ok(0), |&accessor| reader.count(accessor));
        let vertices = count("POSITION")? as u64;
        let triangles = primitive::triangle_count(reader, primitive)? as u64;
        // Without normals, each triangle has vertices of its own.
        let is_flat = !primitive.attributes.contains_key("NORMAL");
        let used = if is_flat { 3 * triangles } else { vertices.min(3 * triangles) };
        let sparse = |accessor: &usize| reader.root.accessors.get(*accessor).and_then(|a| a.sparse.as_ref());
        let replaced = primitive.attributes.values().filter_map(sparse).map(|s| s.count as u64).max().unwrap_or(0);
        let targets = primitive.targets.len() as u64;
        let attributes = primitive.attributes.len() as u64 + 2;
        let per_vertex = ATTRIBUTE * attributes + DISPLACEMENT.saturating_mul(targets);
        let while_read = used
            .saturating_mul(per_vertex)
            .saturating_add(4 * vertices + 3 * 12 * triangles)
            .saturating_add(replaced.saturating_mul(SPARSE));
        Ok(Self { used, triangles, while_read })
    }
}
