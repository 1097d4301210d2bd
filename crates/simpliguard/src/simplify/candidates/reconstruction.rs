//! The reconstruction candidate. Components of the source that touch in the rest pose and move apart are reconstructed
//! separately.
//!
//! A reconstruction merges components that lie within two offsets of each other. The merged surface tears or stretches
//! as soon as they move apart. Therefore touching components with different motions go into different layers, and each
//! layer is reconstructed on its own. Components that move alike where they touch stay together, such as a shirt and
//! its buttons. The layers are a greedy colouring of the graph of conflicts; two or three are usually enough.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use rayon::prelude::*;

use crate::animation::{Poses, influences_at};
use crate::data::{Reconstruction, TriMesh};
use crate::geometry::{Bvh, DisjointSets, Hit};
use crate::simplify::inputs::Inputs;
use crate::simplify::visibility::DIRECTIONS;
use crate::simplify::{visibility, weld};

/// Distance above which two touching points count as moved apart, in cells.
const APART: f32 = 1.0;
/// Two components conflict if more than this fraction of their touching vertices moves apart.
const CONFLICT: f64 = 0.5;
/// Backs of single-sided triangles are left open if they are more than this fraction of the pixels of a reconstruction.
const BACKS: f64 = 0.25;
/// Number of faces of a reconstruction, evenly spread over those that are seen, that tell the fraction of backs.
const BACKS_SAMPLES: usize = 1 << 15;
/// The component of a vertex without opaque triangles.
const NO_COMPONENT: u32 = u32::MAX;

/// Reconstructs the opaque surface, layer by layer.
pub(crate) fn reconstruct(inputs: &Inputs<'_>, params: &Reconstruction) -> TriMesh {
    reconstruct_around(inputs, params, &[])
}

/// Reconstructs the opaque surface, layer by layer, around points of free space.
fn reconstruct_around(inputs: &Inputs<'_>, params: &Reconstruction, free: &[Vec3]) -> TriMesh {
    let opaque = inputs.opaque;
    let layers = inputs.poses.map_or_else(Vec::new, |poses| layers(inputs, poses, params));
    if layers.len() < 2 {
        return inputs.tools.reconstruct(&opaque.mesh, &opaque.bvh, free, params);
    }
    let surfaces: Vec<TriMesh> = layers
        .par_iter()
        .map(|layer| {
            let mesh = opaque.mesh.filtered(|t| layer.contains(&inputs.component(opaque.source[t])));
            let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
            let params = Reconstruction { resolution: params.resolution_for(&opaque.mesh, &mesh), ..*params };
            inputs.tools.reconstruct(&mesh, &bvh, free, &params)
        })
        .collect();
    surfaces.into_iter().reduce(append).unwrap_or_default()
}

fn append(mut all: TriMesh, next: TriMesh) -> TriMesh {
    let base = all.positions.len() as u32;
    all.positions.extend(next.positions);
    all.triangles.extend(next.triangles.iter().map(|t| t.map(|v| v + base)));
    all
}

/// The reconstruction of a source that is seen through the backs of single-sided triangles, as a room is whose walls are
/// seen from within: the space before the triangles that are seen is free, and no face lies over a back. `None` if backs are
/// no good part of what is seen of `closed`, the reconstruction of a solid, whose faces cover `pixels`.
pub(crate) fn seen_through_backs(
    inputs: &Inputs<'_>,
    params: &Reconstruction,
    closed: &TriMesh,
    pixels: &[u32],
) -> Option<TriMesh> {
    if !shows_backs(inputs, closed, pixels) {
        return None;
    }
    let mesh = reconstruct_around(inputs, params, &points_before_seen_triangles(inputs, params));
    let mut fronts: Vec<bool> =
        (0..mesh.triangles.len()).into_par_iter().map(|t| !is_over_back(inputs, &mesh, t)).collect();
    visibility::grow(&mesh, &mut fronts, 1);
    Some(weld::cut(&mesh.filtered(|t| fronts[t])))
}

/// True if backs are a good part of the pixels of a reconstruction.
fn shows_backs(inputs: &Inputs<'_>, mesh: &TriMesh, pixels: &[u32]) -> bool {
    let seen: Vec<usize> = (0..pixels.len()).filter(|&t| pixels[t] > 0).collect();
    let samples = seen.par_iter().step_by(seen.len().div_ceil(BACKS_SAMPLES).max(1));
    let count = |&t: &usize| {
        let n = u64::from(pixels[t]);
        (if is_over_back(inputs, mesh, t) { n } else { 0 }, n)
    };
    let (backs, all) = samples.map(count).reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    backs as f64 > BACKS * all as f64
}

/// True if a face of a reconstruction lies over the back of a single-sided triangle.
fn is_over_back(inputs: &Inputs<'_>, mesh: &TriMesh, face: usize) -> bool {
    let opaque = inputs.opaque;
    let [a, b, c] = mesh.corners(face);
    opaque.bvh.closest((a + b + c) / 3.0, inputs.sphere.radius).is_some_and(|hit| {
        let is_back = opaque.mesh.area_vector(hit.triangle as usize).dot(mesh.area_vector(face)) < 0.0;
        is_back && !is_double_sided(inputs, hit.triangle as usize)
    })
}

fn is_double_sided(inputs: &Inputs<'_>, opaque: usize) -> bool {
    inputs.model.material_of(inputs.opaque.source[opaque]).double_sided
}

/// Points before the opaque triangles that cameras see, beyond the offset of a reconstruction.
fn points_before_seen_triangles(inputs: &Inputs<'_>, params: &Reconstruction) -> Vec<Vec3> {
    let mesh = &inputs.opaque.mesh;
    let double_sided = |t: usize| is_double_sided(inputs, t);
    let pixels =
        visibility::visible_pixels(mesh, &inputs.sphere, DIRECTIONS, &double_sided, inputs.cancellation).covered;
    let distance = 2.0 * params.offset * params.cell(mesh);
    let seen = pixels.iter().enumerate().filter(|(_, pixels)| **pixels > 0);
    seen.map(|(t, _)| {
        let [a, b, c] = mesh.corners(t);
        (a + b + c) / 3.0 + distance * mesh.area_vector(t).normalize_or_zero()
    })
    .collect()
}

/// The components of each layer.
fn layers(inputs: &Inputs<'_>, poses: &Poses<'_>, params: &Reconstruction) -> Vec<BTreeSet<u32>> {
    let components: BTreeSet<u32> = inputs.opaque.source.iter().map(|&t| inputs.component(t)).collect();
    let contacts = contacts(inputs, poses, params);
    let mut alike = DisjointSets::new(components.last().map_or(0, |&last| last as usize + 1));
    let is_conflict = |contact: &ComponentContact| contact.apart as f64 > CONFLICT * contact.vertices as f64;
    for ((a, b), _) in contacts.iter().filter(|(_, contact)| !is_conflict(contact)) {
        alike.join(*a as usize, *b as usize);
    }
    let mut conflicts: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for ((a, b), _) in contacts.iter().filter(|(_, contact)| is_conflict(contact)) {
        let (a, b) = (alike.find(*a as usize), alike.find(*b as usize));
        if a != b {
            conflicts.entry(a).or_default().insert(b);
            conflicts.entry(b).or_default().insert(a);
        }
    }
    let mut layer_of: BTreeMap<usize, usize> = BTreeMap::new();
    let mut layers: Vec<BTreeSet<u32>> = Vec::new();
    for component in components {
        let group = alike.find(component as usize);
        let layer = *layer_of.get(&group).unwrap_or(&{
            let taken: BTreeSet<usize> =
                conflicts.get(&group).into_iter().flatten().filter_map(|other| layer_of.get(other).copied()).collect();
            (0..).find(|layer| !taken.contains(layer)).unwrap_or_default()
        });
        layer_of.insert(group, layer);
        layers.resize(layers.len().max(layer + 1), BTreeSet::new());
        layers[layer].insert(component);
    }
    layers
}

/// The contact of two components.
#[derive(Clone, Copy, Default)]
struct ComponentContact {
    /// Number of vertices of one component that are near the other.
    vertices: usize,
    /// Number of those vertices that some pose moves away from the other component.
    apart: usize,
}

/// Contacts of the pairs of components that a reconstruction would merge; the lower component comes first.
fn contacts(inputs: &Inputs<'_>, poses: &Poses<'_>, params: &Reconstruction) -> BTreeMap<(u32, u32), ComponentContact> {
    let mesh = &inputs.opaque.mesh;
    let mut component_of = vec![NO_COMPONENT; mesh.positions.len()];
    for (triangle, &t) in mesh.triangles.iter().zip(&inputs.opaque.source) {
        triangle.iter().for_each(|&v| component_of[v as usize] = inputs.component(t));
    }
    let cell = params.cell(mesh);
    let near = |(v, &component): (usize, &u32)| -> Option<(u32, u32, Hit)> {
        let other = |t: u32| inputs.component(inputs.opaque.source[t as usize]) != component;
        let hit = inputs.opaque.bvh.closest_where(mesh.positions[v], 2.0 * params.offset * cell, other)?;
        Some((v as u32, component, hit))
    };
    let vertices = component_of.par_iter().enumerate().filter(|(_, component)| **component != NO_COMPONENT);
    let touching: Vec<(u32, u32, Hit)> = vertices.filter_map(near).collect();
    let surface = &inputs.model.surface;
    let own = poses.motions(&touching.iter().map(|(v, ..)| surface.influences[*v as usize]).collect::<Vec<_>>());
    let others: Vec<_> = touching
        .iter()
        .map(|(.., hit)| influences_at(surface, inputs.opaque.source[hit.triangle as usize] as usize, hit.point))
        .collect();
    let others = poses.motions(&others);
    let mut out: BTreeMap<(u32, u32), ComponentContact> = BTreeMap::new();
    for (i, (v, component, hit)) in touching.iter().enumerate() {
        let p = mesh.positions[*v as usize];
        let distances = (0..poses.count()).filter_map(|pose| {
            let (a, b) = (own.of(Some(pose))?[i], others.of(Some(pose))?[i]);
            Some(a.transform_point3(p).distance(b.transform_point3(p)))
        });
        let other = inputs.component(inputs.opaque.source[hit.triangle as usize]);
        let contact = out.entry((*component.min(&other), *component.max(&other))).or_default();
        contact.vertices += 1;
        contact.apart += usize::from(distances.fold(0.0, f32::max) > APART * cell);
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::Mat4;

    use super::*;
    use crate::Cancellation;
    use crate::data::{Bone, Cards, Influences, Material, Model, Pose, Rig, Surface};
    use crate::geometry::{BoundingSphere, Topology};
    use crate::render::SurfaceSampler;
    use crate::simplify::{DeviationMetric, OpaqueSurface, Tools};

    struct ReconstructAlone;

    impl Tools for ReconstructAlone {
        fn reconstruct(&self, mesh: &TriMesh, bvh: &Bvh, free: &[Vec3], params: &Reconstruction) -> TriMesh {
            let cancellation = Cancellation::default();
            crate::reconstruct::reconstruct(mesh, bvh, free, params, &cancellation)
        }

        fn influences(&self, _: &TriMesh) -> Vec<Influences> {
            Vec::new()
        }

        fn has_joint_planes(&self) -> bool {
            false
        }

        fn split_at_joints(&self, mesh: &TriMesh, _: usize) -> TriMesh {
            mesh.clone()
        }

        fn shown(&self, _: &TriMesh, _: Option<&Cards>, points: &[(u32, Vec3)], _: &[f32]) -> Vec<bool> {
            vec![true; points.len()]
        }
    }

    /// Two unit cubes, one above the other with a gap of a thousandth, each with its own bone. A clip lifts the upper
    /// one by `lift`.
    fn stacked(lift: f32) -> Model {
        let mut surface = Surface::default();
        for cube in 0..2u32 {
            let at = Vec3::Y * 1.001 * cube as f32;
            let corner = |i: u32| at + Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
            let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
            surface.positions.extend((0..8).map(corner));
            surface.influences.extend([Influences::rigid(cube as u16); 8]);
            let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
            surface.triangles.extend(faces.map(|t: [u32; 3]| t.map(|v| v + 8 * cube)));
        }
        surface.normals = vec![Vec3::Y; surface.positions.len()];
        surface.material = vec![0; surface.triangles.len()];
        let bone = |node| Bone { node, inverse_bind: Mat4::IDENTITY, rest_world: Mat4::IDENTITY };
        let world = vec![Mat4::from_translation(Vec3::X), Mat4::from_translation(Vec3::X + Vec3::Y * lift)];
        let pose = Pose { frame: Some((0, 0.0)), world };
        let rig = Some(Rig { bones: vec![bone(0), bone(1)], source_skin: Some(0), poses: vec![pose] });
        Model { surface, rig, materials: vec![Material::default()], ..Model::empty("cubes") }
    }

    fn with_inputs<T>(model: &Model, run: impl Fn(&Inputs<'_>) -> T) -> T {
        let bvh = std::sync::Arc::new(Bvh::new(&model.surface.positions, &model.surface.triangles));
        let sampler = SurfaceSampler::new(model);
        let (opaque, poses) = (OpaqueSurface::of(&sampler, &bvh), Poses::of(model, 1, 1, &Cancellation::default()));
        let source = crate::skinning::SkinSource::new(model, &bvh);
        run(&Inputs {
            model,
            bvh: &bvh,
            components: source.components(),
            opaque: &opaque,
            deviation_metric: &DeviationMetric::new(&opaque, &Cancellation::default()),
            sphere: BoundingSphere::around(&model.surface.positions),
            views: &[],
            poses: poses.as_ref(),
            importance: None,
            tools: &ReconstructAlone,
            cancellation: &Cancellation::default(),
        })
    }

    fn components(model: &Model) -> usize {
        let mesh = with_inputs(model, |inputs| reconstruct(inputs, &Reconstruction::new(64)));
        let topology = Topology::of(&mesh);
        assert!(topology.is_closed_manifold(), "{topology:?}");
        topology.components
    }

    /// One cube whose faces look inwards, as the walls of a room do.
    fn room(double_sided: bool) -> Model {
        let mut model = stacked(0.0);
        model.surface.triangles.truncate(12);
        model.surface.material.truncate(12);
        model.surface.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        model.materials[0].double_sided = double_sided;
        Model { rig: None, ..model }
    }

    /// A closed room has no surface that a flood from without reaches: its inner walls come from the free space within.
    #[test]
    fn a_room_is_open_to_the_outside_if_its_walls_are() {
        let open = |model: &Model| {
            with_inputs(model, |inputs| {
                let params = Reconstruction::new(64);
                let mesh = reconstruct(inputs, &params);
                seen_through_backs(inputs, &params, &mesh, &vec![1; mesh.triangles.len()])
            })
        };
        let room_seen_within = open(&room(false)).expect("half of the faces lie over backs");
        let middle = Vec3::splat(0.5);
        let inwards = |t: &usize| {
            let [a, b, c] = room_seen_within.corners(*t);
            room_seen_within.area_vector(*t).dot(middle - (a + b + c) / 3.0) > 0.0
        };
        assert_eq!((0..room_seen_within.triangles.len()).filter(inwards).count(), room_seen_within.triangles.len());
        let area: f32 =
            (0..room_seen_within.triangles.len()).map(|t| 0.5 * room_seen_within.area_vector(t).length()).sum();
        assert!((area - 6.0).abs() < 0.3, "{area}");
        assert!(open(&room(true)).is_none(), "walls of two sides hide the room");
        assert!(open(&Model { rig: None, ..stacked(0.0) }).is_none(), "solids show their fronts");
    }

    #[test]
    fn components_that_move_apart_are_reconstructed_apart() {
        assert_eq!(components(&stacked(0.5)), 2);
    }

    #[test]
    fn components_that_move_together_are_merged() {
        assert_eq!(components(&stacked(0.01)), 1);
    }
}
