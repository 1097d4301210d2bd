//! Parts of a source that touch at rest and move apart, told apart before they are wrapped.
//!
//! A reconstruction grows parts that lie within two offsets of each other into one, which tears or stretches as soon as
//! they move. Touching parts with different motions therefore go into different layers, each wrapped on its own; parts
//! that move alike where they touch stay together, as a shirt and its buttons. The layers are a greedy colouring of the
//! graph of such conflicts: two or three are usually enough.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use crate::animation::Poses;
use crate::data::{Reconstruction, TriMesh};
use crate::geometry::{Bvh, DisjointSets, Hit};
use crate::reconstruct::reconstruct;
use crate::simplify::Inputs;

/// Motion that takes two touching points apart, in cells.
const APART: f32 = 1.0;
/// Part of the touching vertices of two parts that must come apart.
const MOST: f64 = 0.5;

/// Wraps the opaque triangles, parts that move apart each on their own.
pub(crate) fn wrap(inputs: &Inputs<'_>, params: &Reconstruction) -> TriMesh {
    let opaque = inputs.opaque;
    let layers = inputs.poses.map_or_else(Vec::new, |poses| layers(inputs, poses, params));
    if layers.len() < 2 {
        return reconstruct(&opaque.mesh, &opaque.bvh, params, inputs.cancellation);
    }
    let wrapped: Vec<TriMesh> = layers
        .par_iter()
        .map(|layer| {
            let part = opaque.mesh.filtered(|t| layer.contains(&inputs.skin_source.part(opaque.source[t])));
            let bvh = Bvh::new(&part.positions, &part.triangles);
            let params = Reconstruction { resolution: params.resolution_for(&opaque.mesh, &part), ..*params };
            reconstruct(&part, &bvh, &params, inputs.cancellation)
        })
        .collect();
    wrapped.into_iter().reduce(append).unwrap_or_default()
}

fn append(mut all: TriMesh, next: TriMesh) -> TriMesh {
    let base = all.positions.len() as u32;
    all.positions.extend(next.positions);
    all.triangles.extend(next.triangles.iter().map(|t| t.map(|v| v + base)));
    all
}

/// The parts of each layer.
fn layers(inputs: &Inputs<'_>, poses: &Poses<'_>, params: &Reconstruction) -> Vec<BTreeSet<u32>> {
    let parts: BTreeSet<u32> = inputs.opaque.source.iter().map(|&t| inputs.skin_source.part(t)).collect();
    let contacts = contacts(inputs, poses, params);
    let mut alike = DisjointSets::new(parts.last().map_or(0, |&last| last as usize + 1));
    let is_conflict = |contact: &Contact| contact.apart as f64 > MOST * contact.vertices as f64;
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
    for part in parts {
        let group = alike.find(part as usize);
        let layer = *layer_of.get(&group).unwrap_or(&{
            let taken: BTreeSet<usize> =
                conflicts.get(&group).into_iter().flatten().filter_map(|other| layer_of.get(other).copied()).collect();
            (0..).find(|layer| !taken.contains(layer)).unwrap_or_default()
        });
        layer_of.insert(group, layer);
        layers.resize(layers.len().max(layer + 1), BTreeSet::new());
        layers[layer].insert(part);
    }
    layers
}

/// How two parts touch.
#[derive(Clone, Copy, Default)]
struct Contact {
    /// Vertices of one that are near the other.
    vertices: usize,
    /// Those of them that some pose takes away from where the other goes.
    apart: usize,
}

/// Pairs of parts, the lower first, that a reconstruction would grow into one.
fn contacts(inputs: &Inputs<'_>, poses: &Poses<'_>, params: &Reconstruction) -> BTreeMap<(u32, u32), Contact> {
    let (mesh, skin_source) = (&inputs.opaque.mesh, inputs.skin_source);
    let mut part_of = vec![u32::MAX; mesh.positions.len()];
    for (triangle, &t) in mesh.triangles.iter().zip(&inputs.opaque.source) {
        triangle.iter().for_each(|&v| part_of[v as usize] = skin_source.part(t));
    }
    let cell = params.cell(mesh);
    let near = |(v, &part): (usize, &u32)| -> Option<(u32, u32, Hit)> {
        let other = |t: u32| skin_source.part(inputs.opaque.source[t as usize]) != part;
        let hit = inputs.opaque.bvh.closest_where(mesh.positions[v], 2.0 * params.offset * cell, other)?;
        Some((v as u32, part, hit))
    };
    let vertices = part_of.par_iter().enumerate().filter(|(_, part)| **part != u32::MAX);
    let touching: Vec<(u32, u32, Hit)> = vertices.filter_map(near).collect();
    let surface = &inputs.model.surface;
    let own = poses.motions(&touching.iter().map(|(v, ..)| surface.influences[*v as usize]).collect::<Vec<_>>());
    let others: Vec<_> = touching
        .iter()
        .map(|(.., hit)| skin_source.influences_at(inputs.opaque.source[hit.triangle as usize], hit.point))
        .collect();
    let others = poses.motions(&others);
    let mut out: BTreeMap<(u32, u32), Contact> = BTreeMap::new();
    for (i, (v, part, hit)) in touching.iter().enumerate() {
        let p = mesh.positions[*v as usize];
        let parting = (0..poses.count()).filter_map(|pose| {
            let (a, b) = (own.of(Some(pose))?[i], others.of(Some(pose))?[i]);
            Some(a.transform_point3(p).distance(b.transform_point3(p)))
        });
        let other = skin_source.part(inputs.opaque.source[hit.triangle as usize]);
        let contact = out.entry((*part.min(&other), *part.max(&other))).or_default();
        contact.vertices += 1;
        contact.apart += usize::from(parting.fold(0.0, f32::max) > APART * cell);
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, Vec3};

    use super::*;
    use crate::Cancellation;
    use crate::data::{Bone, Influences, Material, Model, Pose, Rig, Surface};
    use crate::geometry::{BoundingSphere, Topology};
    use crate::render::SurfaceSampler;
    use crate::simplify::{DeviationMetric, OpaqueSurface};
    use crate::skinning::SkinSource;

    /// Two unit cubes, one on the other with a gap of a thousandth, a bone each; a clip lifts the upper one by `lift`.
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

    fn components(model: &Model) -> usize {
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        let sampler = SurfaceSampler::new(model);
        let (opaque, poses) = (OpaqueSurface::of(&sampler), Poses::of(model, 1, 1, &Cancellation::default()));
        let inputs = Inputs {
            model,
            bvh: &bvh,
            skin_source: &SkinSource::new(model, &bvh),
            opaque: &opaque,
            deviation_metric: &DeviationMetric::new(&opaque),
            frame: BoundingSphere::around(&model.surface.positions),
            views: &[],
            poses: poses.as_ref(),
            importance: None,
            cancellation: &Cancellation::default(),
        };
        let topology = Topology::of(&wrap(&inputs, &Reconstruction::new(64)));
        assert!(topology.is_closed_manifold(), "{topology:?}");
        topology.components
    }

    #[test]
    fn parts_that_move_apart_are_wrapped_apart() {
        assert_eq!(components(&stacked(0.5)), 2);
    }

    #[test]
    fn parts_that_move_together_grow_together() {
        assert_eq!(components(&stacked(0.01)), 1);
    }
}
