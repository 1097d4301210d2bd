//! The surface of a model: all primitives in world space.

use std::collections::BTreeSet;

use glam::{Mat3, Mat4, Vec3, Vec4};

use super::accessor::Reader;
use super::asset::counted;
use super::influences::influences;
use super::instances::{instance_count, instances};
use super::material::MaterialSlots;
use super::morphs::Driver;
use super::nodes::Tree;
use super::primitive;
use super::primitive_mesh::PrimitiveMesh;
use super::schema::{self, Node};
use super::skeleton::SourceSkeleton;
use crate::Error;
use crate::data::{Influences, Surface};

/// Nodes of the default scene that carry triangles and are no `levels`, after the limit on triangles was checked over all
/// instances.
pub(super) fn mesh_nodes(reader: Reader<'_>, tree: &Tree, levels: &BTreeSet<usize>) -> Result<Vec<usize>, Error> {
    let mut total = 0usize;
    let mut out = Vec::new();
    for &index in tree.nodes.iter().filter(|node| !levels.contains(node)) {
        let node = &reader.root.nodes[index];
        let Some(mesh) = node.mesh else { continue };
        let mut triangles = 0usize;
        for primitive in &reader.asset.item(&reader.root.meshes, mesh, "mesh")?.primitives {
            triangles += primitive::triangle_count(reader, primitive)?;
        }
        if triangles > 0 {
            total = total.saturating_add(triangles.saturating_mul(instance_count(reader, node)?));
            reader.asset.within("the number of triangles", total, reader.asset.limits.triangles)?;
            out.push(index);
        }
    }
    Ok(out)
}

/// The materials of the triangles at `nodes`, ascending, the default material (`None`) last.
pub(super) fn used_materials(reader: Reader<'_>, nodes: &[usize]) -> Vec<Option<usize>> {
    let primitives = primitives(reader, nodes).filter(|primitive| primitive::has_triangles(primitive));
    let mut used: Vec<Option<usize>> = primitives.map(|primitive| primitive.material).collect();
    used.sort_unstable_by_key(|material| (material.is_none(), *material));
    used.dedup();
    used
}

/// Notes for the report: primitives of the default scene that are not triangles.
pub(super) fn skipped_primitives(reader: Reader<'_>, tree: &Tree) -> Vec<String> {
    let skipped = primitives(reader, &tree.nodes).filter(|primitive| !primitive::has_triangles(primitive)).count();
    counted(&[(skipped, "primitives that are points, lines or without positions are left out of the levels")])
}

/// All primitives at `nodes`.
fn primitives<'a>(reader: Reader<'a>, nodes: &[usize]) -> impl Iterator<Item = &'a schema::Primitive<'a>> {
    let meshes = nodes.iter().filter_map(move |&node| reader.root.meshes.get(reader.root.nodes[node].mesh?));
    meshes.flat_map(|mesh| &mesh.primitives)
}

/// The surface, and counts for the report.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    pub(super) surface: Surface,
    /// Number of weights on joints that the skin does not have.
    stray_weights: usize,
}

/// Places primitives in the world.
#[derive(Clone, Copy)]
pub(super) struct Assembler<'a> {
    pub(super) reader: Reader<'a>,
    pub(super) tree: &'a Tree,
    pub(super) skeleton: &'a SourceSkeleton,
    pub(super) driver: &'a Driver,
    pub(super) materials: &'a MaterialSlots,
}

impl Assembler<'_> {
    /// Reads every primitive at `mesh_nodes`, mesh by mesh, so that a mesh of many nodes is read once.
    pub(super) fn assemble(&self, mesh_nodes: &[usize]) -> Result<Assembly, Error> {
        let Self { reader, driver, materials, .. } = *self;
        let mut out = Assembly::default();
        out.surface.morphs.clone_from(&driver.morphs);
        let mut by_mesh: Vec<usize> = mesh_nodes.to_vec();
        by_mesh.sort_by_key(|&node| reader.root.nodes[node].mesh);
        for nodes in by_mesh.chunk_by(|&a, &b| same_shape(&reader.root.nodes[a], &reader.root.nodes[b])) {
            let first = &reader.root.nodes[nodes[0]];
            let Some(mesh) = first.mesh.and_then(|mesh| reader.root.meshes.get(mesh)) else { continue };
            let weights = first.weights.as_ref().unwrap_or(&mesh.weights);
            for primitive in mesh.primitives.iter().filter(|primitive| primitive::has_triangles(primitive)) {
                reader.asset.check()?;
                let (material, uv_sets) = materials.of_primitive(primitive.material);
                let is_driven = nodes.iter().any(|&node| driver.drives(node));
                let part = primitive::read(reader, primitive, weights, is_driven, uv_sets)?;
                for &node in nodes {
                    self.place(&mut out, node, &part, material)?;
                }
            }
        }
        Ok(out)
    }

    /// Adds `part` once for a skinned node, and once per instance for a rigid one.
    fn place(&self, out: &mut Assembly, index: usize, part: &PrimitiveMesh, material: u32) -> Result<(), Error> {
        let node = &self.reader.root.nodes[index];
        let displacements = if self.driver.drives(index) { part.displacements.as_slice() } else { &[] };
        if let (Some(skin), Some(local), Some(rig)) = (node.skin, &part.influences, &self.skeleton.rig) {
            let bones = &self.skeleton.skin_bones[skin];
            let influences: Vec<Influences> = local.iter().map(|local| out.on_bones(local, bones)).collect();
            let matrices: Vec<Mat4> = influences.iter().map(|influences| rig.rest_matrix(influences)).collect();
            out.append_displacements(displacements, |vertex| matrices[vertex]);
            out.append(part, |vertex| matrices[vertex], material);
            out.surface.influences.extend(influences);
            return Ok(());
        }
        let world = self.tree.world[index];
        for instance in instances(self.reader, node)? {
            let matrix = world * instance;
            out.append_displacements(displacements, |_| matrix);
            out.append(part, |_| matrix, material);
            if self.skeleton.rig.is_some() {
                let bone = self.skeleton.node_bones.get(&index).copied().unwrap_or_default();
                out.surface.influences.resize(out.surface.positions.len(), Influences::rigid(bone));
            }
        }
        Ok(())
    }
}

/// True if two nodes have the same mesh with the same morph weights.
fn same_shape(a: &Node<'_>, b: &Node<'_>) -> bool {
    a.mesh == b.mesh && a.weights == b.weights
}

impl Assembly {
    /// Notes for the report.
    pub(super) fn notes(&self) -> Vec<String> {
        counted(&[(self.stray_weights, "weights on joints that the skin does not have are dropped")])
    }

    /// Influences by bone, from influences by joint of a skin. A vertex without weights is bound to the skin's first
    /// joint.
    fn on_bones(&mut self, local: &Influences, bones: &[u16]) -> Influences {
        let pairs = local.joints.iter().zip(local.weights).filter(|(_, weight)| *weight > 0.0);
        let stray = pairs.clone().filter(|(joint, _)| usize::from(**joint) >= bones.len()).count();
        self.stray_weights += stray;
        let known = pairs.filter_map(|(&joint, weight)| Some((*bones.get(usize::from(joint))?, weight)));
        influences(known).unwrap_or_else(|| Influences::rigid(bones.first().copied().unwrap_or_default()))
    }

    /// Adds the displacements of the vertices that [`Self::append`] adds next, from local space to the world by
    /// `matrix`.
    fn append_displacements(&mut self, displacements: &[Vec<Vec3>], matrix: impl Fn(usize) -> Mat4) {
        let base = self.surface.positions.len();
        let targets = self.surface.morphs.iter_mut().flat_map(|morphs| &mut morphs.targets);
        for (target, displacements) in targets.zip(displacements) {
            for (vertex, &offset) in displacements.iter().enumerate() {
                let offset = matrix(vertex).transform_vector3(offset);
                if offset.is_finite() && offset != Vec3::ZERO {
                    target.displacements.push(((base + vertex) as u32, offset));
                }
            }
        }
    }

    /// Adds `part`, each vertex transformed by its matrix. If the matrices mirror most vertices, the faces are flipped,
    /// so that the outside stays outside. Engines do not agree on the front of a double-sided mesh that is mirrored: it is where
    /// its normals point.
    fn append(&mut self, part: &PrimitiveMesh, matrix: impl Fn(usize) -> Mat4, material: u32) {
        let base = self.surface.positions.len();
        let mirrored = self.append_vertices(part, matrix);
        self.append_attributes(part, base);
        let flipped = 2 * mirrored > part.positions.len() && !(part.double_sided && part.is_inverted());
        let numbered = part.triangles.iter().map(|t| t.map(|vertex| vertex + base as u32));
        let surface = &mut self.surface;
        surface.triangles.extend(numbered.map(|[a, b, c]| if flipped { [a, c, b] } else { [a, b, c] }));
        surface.material.resize(surface.triangles.len(), material);
    }

    /// Adds positions, normals and tangents; returns the number of vertices whose matrix mirrors.
    fn append_vertices(&mut self, part: &PrimitiveMesh, matrix: impl Fn(usize) -> Mat4) -> usize {
        let surface = &mut self.surface;
        let mut mirrored = 0;
        let has_tangents = part.tangents.is_some() || !surface.tangents.is_empty();
        surface.tangents.resize(if has_tangents { surface.positions.len() } else { 0 }, Vec4::ZERO);
        for (vertex, (&position, &normal)) in part.positions.iter().zip(&part.normals).enumerate() {
            let matrix = matrix(vertex);
            let linear = Mat3::from_mat4(matrix);
            let handedness = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
            mirrored += usize::from(handedness < 0.0);
            surface.positions.push(matrix.transform_point3(position));
            surface.normals.push((cofactor(linear) * normal * handedness).try_normalize().unwrap_or(Vec3::Y));
            if has_tangents {
                let tangent = part.tangents.as_ref().map_or(Vec4::ZERO, |tangents| tangents[vertex]);
                let direction = (linear * tangent.truncate()).try_normalize().unwrap_or_default();
                let sign = if tangent.w < 0.0 { -handedness } else { handedness };
                let tangent = if direction == Vec3::ZERO { Vec4::ZERO } else { direction.extend(sign) };
                surface.tangents.push(tangent);
            }
        }
        mirrored
    }

    /// Adds texture coordinates and colours of vertices from `base` on, with defaults for missing ones.
    fn append_attributes(&mut self, part: &PrimitiveMesh, base: usize) {
        let surface = &mut self.surface;
        let end = base + part.positions.len();
        for (all, part) in surface.uvs.iter_mut().zip(&part.uvs) {
            match part {
                Some(part) => all.extend_from_slice(part),
                None => all.resize(end, Default::default()),
            }
        }
        if part.colors.is_some() || !surface.colors.is_empty() {
            surface.colors.resize(base, Vec4::ONE);
            surface.colors.extend_from_slice(part.colors.as_deref().unwrap_or_default());
            surface.colors.resize(end, Vec4::ONE);
        }
        if part.painted.is_some() || !surface.painted.is_empty() {
            surface.painted.resize(base, 0.0);
            surface.painted.extend_from_slice(part.painted.as_deref().unwrap_or_default());
            surface.painted.resize(end, 0.0);
        }
    }
}

/// The matrix that transforms normals: the inverse transpose times the determinant. Singular matrices have it too.
fn cofactor(m: Mat3) -> Mat3 {
    Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}
