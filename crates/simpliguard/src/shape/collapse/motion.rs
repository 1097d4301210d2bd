//! Error in motion: the planes of the faces in other poses of the source.
//!
//! After "Deformation Sensitive Decimation" (Mohr and Gleicher 2003): a vertex carries a quadric for each pose beside
//! that of the rest pose, and a collapse is rated by the sum. Where they keep one placement per pose, here the one at
//! rest is moved by the blend of the motions of the edge's ends, as skinning will move it: an edge across which the
//! weights run linearly costs nothing, one that ends where they bend is kept.
//!
//! Planes say nothing about where on them a vertex ends up, but the texture moves with it. As with skin weights that are
//! attributes of the quadric (arXiv 2411.16874), a vertex also carries the affine maps that take its faces into each
//! pose, and errs by how far it strays from where they take its place at rest ([`Slide`]).

use glam::{DAffine3, DMat3, DVec3};

use super::{NONE, Quadric, Simplifier};
use crate::render::Motions;

/// Weight of the squared distance between where a vertex goes and where its surface goes, against that to the planes.
const SLIDE_WEIGHT: f64 = 0.25;

/// Sum of the weighted squared distances between a posed point `m` and where the maps of faces take its place at rest `p`:
/// `sum w |A p + b - m|^2`.
#[derive(Clone, Copy, Debug, Default)]
struct Slide {
    /// `sum w A^T A`, `sum w A` and `sum w A^T b`.
    squares: DMat3,
    linear: DMat3,
    mixed: DVec3,
    /// `sum w b`, `sum w b.b` and `sum w`.
    offset: DVec3,
    constant: f64,
    weight: f64,
}

impl Slide {
    /// The map of one face, given its corners at rest and in the pose; what is off the face keeps its distance.
    fn of(rest: [DVec3; 3], posed: [DVec3; 3], weight: f64) -> Self {
        let frame = |[a, b, c]: [DVec3; 3]| DMat3::from_cols(b - a, c - a, (b - a).cross(c - a).normalize_or_zero());
        let linear = frame(posed) * frame(rest).inverse();
        if !linear.is_finite() {
            return Self::default();
        }
        let offset = posed[0] - linear * rest[0];
        let transposed = linear.transpose();
        Self {
            squares: transposed * linear * weight,
            linear: linear * weight,
            mixed: transposed * offset * weight,
            offset: offset * weight,
            constant: offset.length_squared() * weight,
            weight,
        }
    }

    fn add(&mut self, other: &Self) {
        self.squares += other.squares;
        self.linear += other.linear;
        self.mixed += other.mixed;
        self.offset += other.offset;
        self.constant += other.constant;
        self.weight += other.weight;
    }

    fn error(&self, rest: DVec3, posed: DVec3) -> f64 {
        let own = rest.dot(self.squares * rest) + 2.0 * self.mixed.dot(rest) + self.constant;
        let both = posed.dot(self.linear * rest + self.offset);
        (own - 2.0 * both + self.weight * posed.length_squared()).max(0.0)
    }
}

/// Quadrics and motions of the vertices that were left when the poses were brought in.
#[derive(Clone)]
pub(super) struct InMotion {
    poses: usize,
    /// Place of each vertex in the lists below, of one entry per pose each.
    slots: Vec<u32>,
    quadrics: Vec<Quadric>,
    slides: Vec<Slide>,
    motions: Vec<DAffine3>,
}

impl InMotion {
    /// Error of the edge `u v`, collapsed at rest to `place`, which is a part `t` of the way from `u` to `v`.
    pub(super) fn error(&self, u: u32, v: u32, t: f64, place: DVec3) -> f64 {
        let [u, v] = [u, v].map(|vertex| self.slots[vertex as usize] as usize * self.poses);
        let in_pose = |pose: usize| {
            let (u, v) = (u + pose, v + pose);
            let moved = self.motions[u].transform_point3(place).lerp(self.motions[v].transform_point3(place), t);
            let planes = self.quadrics[u].error(moved) + self.quadrics[v].error(moved);
            planes + SLIDE_WEIGHT * (self.slides[u].error(place, moved) + self.slides[v].error(place, moved))
        };
        (0..self.poses).map(in_pose).sum()
    }

    /// What `v` was becomes part of `u`, a part `t` of the way from `u` to `v`.
    pub(super) fn merge(&mut self, u: u32, v: u32, t: f64) {
        let [u, v] = [u, v].map(|vertex| self.slots[vertex as usize] as usize * self.poses);
        for pose in 0..self.poses {
            let other = self.quadrics[v + pose];
            self.quadrics[u + pose].add(&other);
            let other = self.slides[v + pose];
            self.slides[u + pose].add(&other);
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
    pub(in crate::shape) fn follow(&mut self, poses: usize, motions: impl FnOnce(&[glam::Vec3]) -> Motions) {
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
            slides: vec![Slide::default(); vertices.len() * poses],
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
                let rest = face.map(|v| self.positions[v as usize]);
                let [a, b, c] = [0, 1, 2].map(|k| out.motions[starts[k] + pose].transform_point3(rest[k]));
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let plane = Quadric::plane(normal, -normal.dot(a), weight);
                let slide = Slide::of(rest, [a, b, c], weight);
                for start in starts {
                    out.quadrics[start + pose].add(&plane);
                    out.slides[start + pose].add(&slide);
                }
            }
        }
    }
}
