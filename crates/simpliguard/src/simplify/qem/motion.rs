//! Error in motion: the planes of the faces in other poses of the source.
//!
//! After "Deformation Sensitive Decimation" (Mohr and Gleicher 2003): a vertex carries a quadric for each pose beside
//! that of the rest pose, and a collapse is rated by the sum. Where they keep one placement per pose, here the one at
//! rest is moved by the blend of the motions of the edge's ends, as skinning will move it: an edge across which the
//! weights run linearly costs nothing, one that ends where they bend is kept.

use glam::{DAffine3, DMat3, DVec3};

use super::{NONE, Quadric, Simplifier};
use crate::animation::Motions;

/// Quadrics and motions of the vertices that were left when the poses were brought in.
#[derive(Clone)]
pub(super) struct InMotion {
    poses: usize,
    /// Place of each vertex in the lists below, of one entry per pose each.
    slots: Vec<u32>,
    quadrics: Vec<Quadric>,
    motions: Vec<DAffine3>,
}

impl InMotion {
    fn of(&self, vertex: u32) -> impl Iterator<Item = (&Quadric, &DAffine3)> {
        let start = self.slots[vertex as usize] as usize * self.poses;
        let own = start..start + self.poses;
        self.quadrics[own.clone()].iter().zip(&self.motions[own])
    }

    /// Error of the edge `u v`, collapsed at rest to `place`, which is a part `t` of the way from `u` to `v`.
    pub(super) fn error(&self, u: u32, v: u32, t: f64, place: DVec3) -> f64 {
        let both = self.of(u).zip(self.of(v));
        both.map(|((qu, mu), (qv, mv))| {
            let moved = mu.transform_point3(place).lerp(mv.transform_point3(place), t);
            qu.error(moved) + qv.error(moved)
        })
        .sum()
    }

    /// What `v` was becomes part of `u`, a part `t` of the way from `u` to `v`.
    pub(super) fn merge(&mut self, u: u32, v: u32, t: f64) {
        let [u, v] = [u, v].map(|vertex| self.slots[vertex as usize] as usize * self.poses);
        for pose in 0..self.poses {
            let other = self.quadrics[v + pose];
            self.quadrics[u + pose].add(&other);
            self.motions[u + pose] = blend(&self.motions[u + pose], &self.motions[v + pose], t);
        }
    }
}

fn blend(a: &DAffine3, b: &DAffine3, t: f64) -> DAffine3 {
    let columns = |m: &DAffine3| [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
    let [x, y, z, w] = std::array::from_fn(|k| columns(a)[k].lerp(columns(b)[k], t));
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: w }
}

impl Simplifier {
    /// Rates collapses from here on by `poses` poses too, which together weigh as much as the rest pose. `motions` are
    /// those of positions in the simplifier's space.
    pub(in crate::simplify) fn follow(&mut self, poses: usize, motions: impl FnOnce(&[glam::Vec3]) -> Motions) {
        let vertices: Vec<u32> = (0..self.first.len() as u32).filter(|&v| self.first[v as usize] != NONE).collect();
        let positions: Vec<glam::Vec3> = vertices.iter().map(|&v| self.positions[v as usize].as_vec3()).collect();
        let motions = motions(&positions);
        let mut slots = vec![NONE; self.first.len()];
        for (slot, &v) in vertices.iter().enumerate() {
            slots[v as usize] = slot as u32;
        }
        let motion = |slot: usize, pose: usize| {
            motions.of(Some(pose)).map_or(DAffine3::IDENTITY, |motions| {
                let m = motions[slot];
                DAffine3 { matrix3: glam::Mat3::from(m.matrix3).as_dmat3(), translation: m.translation.as_dvec3() }
            })
        };
        let motions =
            (0..vertices.len()).flat_map(|slot| (0..poses).map(move |pose| (slot, pose))).map(|(s, p)| motion(s, p));
        let mut out = InMotion {
            poses,
            slots,
            motions: motions.collect(),
            quadrics: vec![Quadric::default(); vertices.len() * poses],
        };
        self.add_posed_planes(&mut out);
        self.in_motion = Some(out);
    }

    fn add_posed_planes(&self, out: &mut InMotion) {
        // What has collapsed into a vertex, shared among its faces.
        let share = |v: u32| self.mass[v as usize] / (3 * self.faces_of(v).count()).max(1) as f64;
        for face in self.live().map(|f| self.faces[f as usize].vertices) {
            let weight = face.iter().map(|&v| share(v)).sum::<f64>() / out.poses as f64;
            let starts = face.map(|v| out.slots[v as usize] as usize * out.poses);
            for pose in 0..out.poses {
                let moved = |k: usize| out.motions[starts[k] + pose].transform_point3(self.positions[face[k] as usize]);
                let [a, b, c] = [0, 1, 2].map(moved);
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let plane = Quadric::plane(normal, -normal.dot(a), weight);
                starts.iter().for_each(|&start| out.quadrics[start + pose].add(&plane));
            }
        }
    }
}
