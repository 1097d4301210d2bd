//! All primitives in world space as one surface, cleaned.

use glam::{Mat3, Mat4, Quat, Vec3, Vec4};

use super::accessor::Reader;
use super::material::Materials;
use super::morphs::Driver;
use super::nodes::{Tree, trs};
use super::primitive::{self, Primitive};
use super::rig::{self, Skeleton};
use super::schema::Node;
use crate::Error;
use crate::data::{Influences, Surface};

/// Materials as the surface needs them.
pub(super) struct MaterialSlots {
    /// For each glTF material, and last for none, its index in the model.
    pub(super) model_index: Vec<Option<u32>>,
    /// For each glTF material, and last for none, the `TEXCOORD_n` that become the two sets.
    pub(super) uv_sets: Vec<[usize; 2]>,
}

impl MaterialSlots {
    /// For a file of `count` materials, of which `materials` holds those in `used`.
    pub(super) fn of(used: &[Option<usize>], materials: &Materials, count: usize) -> Self {
        let mut out = Self { model_index: vec![None; count + 1], uv_sets: vec![[0, 1]; count + 1] };
        for (k, material) in used.iter().enumerate() {
            let slot = out.slot(*material);
            out.model_index[slot] = Some(k as u32);
            out.uv_sets[slot] = materials.uv_sets[k];
        }
        out
    }

    fn slot(&self, material: Option<usize>) -> usize {
        let none = self.uv_sets.len() - 1;
        material.map_or(none, |material| material.min(none))
    }
}

/// What went into the surface besides its triangles.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    pub(super) surface: Surface,
    /// Weights on joints that the skin does not have.
    pub(super) stray_weights: usize,
}

/// Nodes of the default scene with triangles to them, after the limit on triangles was checked over all instances.
pub(super) fn mesh_nodes(reader: Reader<'_>, tree: &Tree) -> Result<Vec<usize>, Error> {
    let mut total = 0usize;
    let mut out = Vec::new();
    for &index in &tree.nodes {
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

/// Reads every primitive of the mesh nodes, mesh by mesh, so that a mesh with many nodes is read once.
pub(super) fn assemble(
    reader: Reader<'_>,
    tree: &Tree,
    mesh_nodes: &[usize],
    skeleton: &Skeleton,
    driver: &Driver,
    materials: &MaterialSlots,
) -> Result<Assembly, Error> {
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
            let slot = materials.slot(primitive.material);
            let drives = nodes.iter().any(|&node| driver.drives(node));
            let mut part = primitive::read(reader, primitive, weights, drives, materials.uv_sets[slot])?;
            let moves = std::mem::take(&mut part.moves);
            let material = materials.model_index[slot].unwrap_or_default();
            for &node in nodes {
                let moves = if driver.drives(node) { moves.as_slice() } else { &[] };
                out.place(reader, tree, skeleton, node, (&part, moves), material)?;
            }
        }
    }
    Ok(out)
}

fn same_shape(a: &Node<'_>, b: &Node<'_>) -> bool {
    a.mesh == b.mesh && a.weights == b.weights
}

impl Assembly {
    fn place(
        &mut self,
        reader: Reader<'_>,
        tree: &Tree,
        skeleton: &Skeleton,
        index: usize,
        (part, moves): (&Primitive, &[Vec<Vec3>]),
        material: u32,
    ) -> Result<(), Error> {
        let node = &reader.root.nodes[index];
        if let (Some(skin), Some(local), Some(rig)) = (node.skin, &part.influences, &skeleton.rig) {
            let bones = &skeleton.skin_bones[skin];
            let influences: Vec<Influences> = local.iter().map(|local| self.on_bones(local, bones)).collect();
            let matrices: Vec<Mat4> = influences.iter().map(|influences| rig.rest_matrix(influences)).collect();
            self.append_moves(moves, |vertex| matrices[vertex]);
            self.append(part, |vertex| matrices[vertex], material);
            self.surface.influences.extend(influences);
            return Ok(());
        }
        let world = tree.world[index];
        for instance in instances(reader, node)? {
            let matrix = world * instance;
            self.append_moves(moves, |_| matrix);
            self.append(part, |_| matrix, material);
            if skeleton.rig.is_some() {
                let bone = skeleton.node_bones.get(&index).copied().unwrap_or_default();
                self.surface.influences.resize(self.surface.positions.len(), Influences::rigid(bone));
            }
        }
        Ok(())
    }

    /// From a skin's joint numbers to bones; a vertex without weight hangs on the skin's first joint.
    fn on_bones(&mut self, local: &Influences, bones: &[u16]) -> Influences {
        let pairs = local.joints.iter().zip(local.weights).filter(|(_, weight)| *weight > 0.0);
        let stray = pairs.clone().filter(|(joint, _)| usize::from(**joint) >= bones.len()).count();
        self.stray_weights += stray;
        let known = pairs.filter_map(|(&joint, weight)| Some((*bones.get(usize::from(joint))?, weight)));
        rig::influences(known).unwrap_or_else(|| Influences::rigid(bones.first().copied().unwrap_or_default()))
    }

    /// Adds what morph targets do to the vertices that come next, each in the space that its matrix leads out of.
    fn append_moves(&mut self, moves: &[Vec<Vec3>], matrix: impl Fn(usize) -> Mat4) {
        let base = self.surface.positions.len();
        let targets = self.surface.morphs.iter_mut().flat_map(|morphs| &mut morphs.targets);
        for (target, moves) in targets.zip(moves) {
            for (vertex, &offset) in moves.iter().enumerate() {
                let offset = matrix(vertex).transform_vector3(offset);
                if offset.is_finite() && offset != Vec3::ZERO {
                    target.moves.push(((base + vertex) as u32, offset));
                }
            }
        }
    }

    /// Adds `part`, each vertex moved by its matrix. Where that mirrors most vertices, the faces are turned, so that
    /// the outside stays outside.
    fn append(&mut self, part: &Primitive, matrix: impl Fn(usize) -> Mat4, material: u32) {
        let surface = &mut self.surface;
        let base = surface.positions.len();
        let count = part.positions.len();
        let mut mirrored = 0;
        let has_tangents = part.tangents.is_some() || !surface.tangents.is_empty();
        surface.tangents.resize(if has_tangents { base } else { 0 }, Vec4::ZERO);
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
        for (all, part) in surface.uvs.iter_mut().zip(&part.uvs) {
            match part {
                Some(part) => all.extend_from_slice(part),
                None => all.resize(base + count, Default::default()),
            }
        }
        if part.colors.is_some() || !surface.colors.is_empty() {
            surface.colors.resize(base, Vec4::ONE);
            surface.colors.extend_from_slice(part.colors.as_deref().unwrap_or_default());
            surface.colors.resize(base + count, Vec4::ONE);
        }
        if part.painted.is_some() || !surface.painted.is_empty() {
            surface.painted.resize(base, 0.0);
            surface.painted.extend_from_slice(part.painted.as_deref().unwrap_or_default());
            surface.painted.resize(base + count, 0.0);
        }
        let turned = 2 * mirrored > count;
        let numbered = part.triangles.iter().map(|t| t.map(|vertex| vertex + base as u32));
        surface.triangles.extend(numbered.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
        surface.material.resize(surface.triangles.len(), material);
    }
}

/// Matrix that carries normals: the inverse transpose times the determinant, defined for singular matrices too.
fn cofactor(m: Mat3) -> Mat3 {
    Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// The transforms of `EXT_mesh_gpu_instancing`; one identity without it.
fn instances(reader: Reader<'_>, node: &Node<'_>) -> Result<Vec<Mat4>, Error> {
    let Some(instancing) = &node.extensions.instancing else { return Ok(vec![Mat4::IDENTITY]) };
    let count = instance_count(reader, node)? as u32;
    let attribute = |name: &str| instancing.attributes.get(name).copied();
    let vectors = |name: &str, missing: Vec3| -> Result<Vec<Vec3>, Error> {
        Ok(match attribute(name) {
            Some(accessor) => reader.floats(accessor, 0..count)?.into_iter().map(Vec3::from).collect(),
            None => vec![missing; count as usize],
        })
    };
    let rotations = match attribute("ROTATION") {
        Some(accessor) => reader.floats(accessor, 0..count)?.into_iter().map(Quat::from_array).collect(),
        None => vec![Quat::IDENTITY; count as usize],
    };
    let (translations, scales) = (vectors("TRANSLATION", Vec3::ZERO)?, vectors("SCALE", Vec3::ONE)?);
    Ok(translations.iter().zip(rotations).zip(scales).map(|((&t, r), s)| trs(t, r, s)).collect())
}

fn instance_count(reader: Reader<'_>, node: &Node<'_>) -> Result<usize, Error> {
    let Some(instancing) = &node.extensions.instancing else { return Ok(1) };
    let known = ["TRANSLATION", "ROTATION", "SCALE"].map(|name| instancing.attributes.get(name));
    known.into_iter().flatten().next().map_or(Ok(1), |&accessor| reader.count(accessor))
}
