//! Joint planes (SimpliGuard, section 3.5): planes across the limbs, where they bend.
//!
//! Two bones meet where the two largest weights of the source's vertices are about equal. Such vertices are grouped by
//! their two bones. The plane of a group goes through its centre, across the limb. Faces of a level are split along it,
//! so that the level has vertices where the limb bends.
//!
//! The paper finds the groups among the vertices of the low-poly mesh. Few of these have weights that close. Here the
//! groups are found among the vertices of the source, and all levels share the planes.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::animation::Skeleton;
use crate::data::{Influences, Model};

/// Edges are only split between these fractions of their length; otherwise slivers would result.
const INNER: std::ops::RangeInclusive<f32> = 0.15..=0.85;
/// Reach of a plane, as a multiple of the mean distance of its vertices from its centre.
const REACH: f32 = 2.0;
/// Least weight on the two bones of a plane for a vertex whose edges the plane may split.
const ON_BONES: f32 = 0.5;
/// Fewest source vertices of a plane.
const FEWEST: usize = 3;

/// A plane across a limb, where two bones meet.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPlane {
    /// Centre of the vertices between the bones, in world space.
    pub centre: Vec3,
    /// Unit normal, along the limb.
    pub normal: Vec3,
    /// Distance from the centre up to which the plane splits edges, in metres.
    pub reach: f32,
    /// The two joints, as numbered in [`Skeleton`], the lower first.
    pub joints: [usize; 2],
}

/// The planes of a model, the one with the largest reach first. They go through the vertices whose two largest weights
/// differ by less than `delta`. Empty for a model without bones.
pub fn joint_planes(model: &Model, delta: f32) -> Vec<JointPlane> {
    let Some(skeleton) = Skeleton::of(model) else { return Vec::new() };
    let surface = &model.surface;
    let mut groups: BTreeMap<[usize; 2], Vec<Vec3>> = BTreeMap::new();
    for (position, influences) in surface.positions.iter().zip(&surface.influences) {
        let [first, second, ..] = influences.weights;
        if second > 0.0 && first - second < delta {
            let mut pair = [skeleton.of_bone(influences.joints[0]), skeleton.of_bone(influences.joints[1])];
            pair.sort_unstable();
            groups.entry(pair).or_default().push(*position);
        }
    }
    let mut planes: Vec<JointPlane> =
        groups.iter().filter_map(|(pair, positions)| JointPlane::through(&skeleton, *pair, positions)).collect();
    planes.sort_by(|a, b| b.reach.total_cmp(&a.reach));
    planes
}

impl JointPlane {
    /// The plane between two joints through the centre of `positions`; `None` if there are too few positions or if they
    /// have no extent.
    fn through(skeleton: &Skeleton<'_>, pair: [usize; 2], positions: &[Vec3]) -> Option<Self> {
        let [a, b] = pair;
        let normal = match (skeleton.parent(a), skeleton.parent(b)) {
            _ if positions.len() < FEWEST || a == b => return None,
            (_, Some(above)) if above == a => skeleton.axis(b),
            (Some(above), _) if above == b => skeleton.axis(a),
            _ => (skeleton.place(b) - skeleton.place(a)).normalize_or_zero(),
        };
        let centre = positions.iter().sum::<Vec3>() / positions.len() as f32;
        let spread = positions.iter().map(|p| p.distance(centre)).sum::<f32>() / positions.len() as f32;
        (normal != Vec3::ZERO && spread > 0.0).then_some(Self { centre, normal, reach: REACH * spread, joints: pair })
    }

    /// The parameter at which the plane splits the edge from `a` to `b`, 0 at `a` and 1 at `b`; `None` if it does not.
    pub(super) fn crossing(&self, a: Vec3, b: Vec3) -> Option<f32> {
        let (from, to) = (self.normal.dot(a - self.centre), self.normal.dot(b - self.centre));
        let t = from / (from - to);
        let is_near = || a.lerp(b, t).distance(self.centre) <= self.reach;
        ((from < 0.0) != (to < 0.0) && INNER.contains(&t) && is_near()).then_some(t)
    }

    /// True if a vertex follows the two bones of the plane enough for its edges to be split.
    pub(super) fn concerns(&self, skeleton: &Skeleton<'_>, influences: &Influences) -> bool {
        let slots = influences.joints.iter().zip(influences.weights).filter(|(_, weight)| *weight > 0.0);
        let own = slots.filter(|(bone, _)| self.joints.contains(&skeleton.of_bone(**bone)));
        own.map(|(_, weight)| weight).sum::<f32>() >= ON_BONES
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::animation::{arm, blended};

    /// A tube of square section along x from 0 to 2 around the arm, open at the ends, with `rings` rings of four
    /// vertices. The weights go from bone 0 to bone 1 around x = 0.9, where the elbow bends.
    pub(crate) fn tube(rings: usize) -> Model {
        let mut model = arm();
        for i in 0..rings {
            let x = 2.0 * i as f32 / (rings - 1) as f32;
            for [y, z] in [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]] {
                model.surface.positions.push(Vec3::new(x, y, z));
                let second = (0.5 + (x - 0.9)).clamp(0.0, 1.0);
                model.surface.influences.push(blended(&Influences::rigid(0), &Influences::rigid(1), second));
            }
        }
        for ring in 0..rings as u32 - 1 {
            for k in 0..4 {
                let [a, b] = [4 * ring + k, 4 * ring + (k + 1) % 4];
                model.surface.triangles.extend([[a, a + 4, b + 4], [a, b + 4, b]]);
            }
        }
        model.surface.normals = vec![Vec3::Y; model.surface.positions.len()];
        model.surface.material = vec![0; model.surface.triangles.len()];
        model
    }

    #[test]
    fn a_plane_stands_where_two_bones_are_equal_across_the_limb() {
        let planes = joint_planes(&tube(41), 0.15);
        assert_eq!(planes.len(), 1);
        assert!(planes[0].centre.distance(Vec3::X * 0.9) < 1e-5, "{planes:?}");
        assert_eq!((planes[0].normal, planes[0].joints), (Vec3::X, [0, 1]));
    }

    #[test]
    fn rigid_parts_have_no_planes() {
        let mut model = tube(41);
        model.surface.influences.fill(Influences::rigid(1));
        assert_eq!(joint_planes(&model, 0.5), []);
    }
}
