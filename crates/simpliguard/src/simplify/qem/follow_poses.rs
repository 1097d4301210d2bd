//! Adds the poses of the source to the quadrics of a mesh.

use glam::{DAffine3, Mat3, Vec3};

use super::posed_quadrics::PosedQuadrics;
use super::quadric::Quadric;
use super::simplifier::{NO_CORNER, Simplifier};
use crate::animation::Motions;
use crate::geometry::area_vector;

impl Simplifier {
    /// Counts the error in `poses` poses from here on. Together they weigh as much as the rest pose. `motions` returns
    /// the motions of positions in the coordinates of the simplifier.
    pub(crate) fn follow(&mut self, poses: usize, motions: impl FnOnce(&[Vec3]) -> Motions) {
        let live: Vec<u32> = (0..self.first.len() as u32).filter(|&v| self.first[v as usize] != NO_CORNER).collect();
        let positions: Vec<Vec3> = live.iter().map(|&v| self.positions[v as usize].as_vec3()).collect();
        let motions = motions(&positions);
        let motion = |slot: usize, pose: usize| {
            motions.of(Some(pose)).map_or(DAffine3::IDENTITY, |motions| {
                let m = motions[slot];
                DAffine3 { matrix3: Mat3::from(m.matrix3).as_dmat3(), translation: m.translation.as_dvec3() }
            })
        };
        let slots = 0..live.len();
        let motions = slots.flat_map(|slot| (0..poses).map(move |pose| (slot, pose))).map(|(s, p)| motion(s, p));
        let mut posed = PosedQuadrics::new(self.first.len(), &live, motions.collect());
        self.add_posed_planes(&mut posed);
        self.posed = Some(posed);
    }

    /// Adds the planes of the posed faces.
    fn add_posed_planes(&self, posed: &mut PosedQuadrics) {
        // A vertex shares its mass among its faces.
        let share = |v: u32| self.mass[v as usize] / (3 * self.faces_of(v).count()).max(1) as f64;
        for face in self.live().map(|f| self.face(f)) {
            let weight = face.iter().map(|&v| share(v)).sum::<f64>() / posed.poses() as f64;
            for pose in 0..posed.poses() {
                let corners = face.map(|v| posed.posed(v, pose, self.positions[v as usize]));
                let normal = area_vector(&corners).normalize_or_zero();
                let plane = Quadric::plane(normal, -normal.dot(corners[0]), weight);
                face.iter().for_each(|&v| posed.add(v, pose, &plane));
            }
        }
    }
}
