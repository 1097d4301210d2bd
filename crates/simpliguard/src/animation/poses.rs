//! The poses that levels are made for, besides the rest pose.

use glam::{Affine3A, DMat4, Quat, Vec3};
use rayon::prelude::*;

use super::closest::closest_influences;
use super::linear_blend::{BoundVertices, LinearBlend};
use super::motions::Motions;
use super::pose_distances::PoseDistances;
use super::skeleton::Skeleton;
use crate::Cancellation;
use crate::data::{Influences, Model, Pose, Surface, TriMesh};
use crate::geometry::Bvh;

/// Approximate number of vertices by which poses are compared.
const SAMPLES: usize = 512;
/// Most poses to choose from. Of more, an even selection is compared: the time grows with the square of their number.
const MOST_COMPARED: usize = 2048;
/// Candidates that are compared beside each other.
const AT_ONCE: usize = 64;
/// Least gain of a pose, as a fraction of the summed squared distances of the rest pose's vertices from their mean.
const LEAST_GAIN: f64 = 1e-6;

/// Angle in radians by which joints are rotated where there are no clips.
const HINGE_ANGLE: f32 = std::f32::consts::FRAC_PI_4;

/// Frames of the source's clips that represent all of them, the most important first. Without clips the poses are the
/// rest pose with one joint rotated like a hinge, in both directions.
pub struct Poses<'a> {
    model: &'a Model,
    blend: LinearBlend<'a>,
    /// The vertices of the source.
    source: BoundVertices<'a>,
    /// The matrix of each bone in each pose.
    bones: Vec<Vec<DMat4>>,
    /// Number of poses that simplification takes into account.
    decisive: usize,
}

impl<'a> Poses<'a> {
    /// Up to `most` poses. Simplification takes the first `n` of them into account. `None` for a model without bones,
    /// for clips that do not move the vertices, and if `n` is zero.
    pub fn of(model: &'a Model, n: usize, most: usize, cancellation: &Cancellation) -> Option<Self> {
        let blend = LinearBlend::of(model).filter(|_| n > 0)?;
        let turned = if blend.poses().is_empty() { turned_joints(model) } else { Vec::new() };
        let all = if turned.is_empty() { blend.poses() } else { &turned };
        let chosen = representative(&blend, all, &model.surface, most.max(n), cancellation);
        let bones: Vec<Vec<DMat4>> = chosen.iter().map(|pose| blend.bones(pose)).collect();
        let source = blend.bind(&model.surface.influences);
        (!bones.is_empty()).then(|| Self { model, blend, source, decisive: n.min(bones.len()), bones })
    }

    /// Number of poses that simplification takes into account; they are the first ones.
    pub fn count(&self) -> usize {
        self.decisive
    }

    /// The matrix of each bone in each pose.
    pub(crate) fn bones(&self) -> &[Vec<DMat4>] {
        &self.bones
    }

    /// Number of all poses.
    pub fn all(&self) -> usize {
        self.bones.len()
    }

    /// Vertices with these influences, to be moved into poses.
    pub fn bind<'v>(&self, influences: &'v [Influences]) -> BoundVertices<'v> {
        self.blend.bind(influences)
    }

    /// The motion of each vertex into one pose.
    pub fn motions_into(&self, pose: usize, vertices: &BoundVertices<'_>) -> Vec<Affine3A> {
        self.blend.motions(&self.bones[pose], vertices)
    }

    /// The motions into all poses.
    pub fn all_motions(&self, influences: &[Influences]) -> Motions {
        self.first_motions(self.all(), influences)
    }

    /// The motions into the first [`Self::count`] poses.
    pub fn motions(&self, influences: &[Influences]) -> Motions {
        self.first_motions(self.decisive, influences)
    }

    fn first_motions(&self, poses: usize, influences: &[Influences]) -> Motions {
        let vertices = self.bind(influences);
        Motions::new((0..poses).map(|pose| self.motions_into(pose, &vertices)).collect())
    }

    /// As [`Self::motions`], with the influences at the closest points of the source, whose triangles `bvh` holds.
    pub fn motions_by_closest_point(&self, bvh: &Bvh, positions: &[Vec3]) -> Motions {
        self.motions(&closest_influences(&self.model.surface, bvh, positions))
    }

    /// The derivative of a vertex's position in a pose with respect to each of its weights; `position` is that of the
    /// rest pose. See [`LinearBlend::by_weights`].
    pub fn by_weights(&self, pose: usize, influences: &Influences, position: Vec3) -> [Vec3; 4] {
        self.blend.by_weights(&self.bones[pose], influences, position)
    }

    /// The positions of the source's vertices in a pose.
    pub fn source_in(&self, pose: usize) -> Vec<Vec3> {
        moved(&self.model.surface.positions, &self.motions_into(pose, &self.source))
    }

    /// The mesh in each of the first [`Self::count`] poses.
    pub fn posed<'m>(&self, mesh: &'m TriMesh, motions: &'m Motions) -> impl Iterator<Item = TriMesh> + 'm {
        let poses = 0..self.count();
        poses.map(|pose| TriMesh {
            positions: motions.of(Some(pose)).map_or_else(|| mesh.positions.clone(), |m| moved(&mesh.positions, m)),
            triangles: mesh.triangles.clone(),
        })
    }
}

/// The rest pose with each joint rotated, in both directions.
fn turned_joints(model: &Model) -> Vec<Pose> {
    let Some(skeleton) = Skeleton::of(model) else { return Vec::new() };
    let turned = |joint: usize| {
        let axis = skeleton.hinge_axis(joint);
        axis.into_iter().flat_map(move |axis| [(joint, axis, HINGE_ANGLE), (joint, axis, -HINGE_ANGLE)])
    };
    let hinges = (0..skeleton.count()).flat_map(turned);
    hinges.map(|(joint, axis, angle)| skeleton.turned(joint, Quat::from_axis_angle(axis, angle))).collect()
}

/// Moves each position by its own motion.
fn moved(positions: &[Vec3], motions: &[Affine3A]) -> Vec<Vec3> {
    positions.iter().zip(motions).map(|(&p, motion)| motion.transform_point3(p)).collect()
}

/// Up to `n` poses that, with the rest pose, represent all of them.
///
/// The choice is greedy. Each pose lowers the sum of squared distances between all poses and their nearest chosen one
/// by as much as any pose can. The position of the model as a whole makes no difference.
fn representative<'p>(
    blend: &LinearBlend<'_>,
    poses: &'p [Pose],
    surface: &Surface,
    n: usize,
    cancellation: &Cancellation,
) -> Vec<&'p Pose> {
    let step = surface.positions.len().div_ceil(SAMPLES).max(1);
    let influences: Vec<Influences> = surface.influences.iter().step_by(step).copied().collect();
    let bound = blend.bind(&influences);
    let rest: Vec<Vec3> = surface.positions.iter().step_by(step).copied().collect();
    let poses: Vec<&Pose> = poses.iter().step_by(poses.len().div_ceil(MOST_COMPARED).max(1)).collect();
    let posed: Vec<Vec<Vec3>> = poses
        .iter()
        .take_while(|_| !cancellation.is_cancelled())
        .map(|pose| centred(moved(&rest, &blend.motions(&blend.bones(pose), &bound))))
        .collect();
    let rest = centred(rest);
    let least_gain = LEAST_GAIN * rest.iter().map(|p| f64::from(p.length_squared())).sum::<f64>();
    let distances = PoseDistances::new(&posed);
    let mut nearest = Vec::with_capacity(posed.len());
    distances.each(&rest, |_, d| nearest.push(d));
    let mut gains = Gains { bounds: vec![f64::INFINITY; posed.len()] };
    let mut chosen = Vec::new();
    while chosen.len() < n && !cancellation.is_cancelled() {
        let gain = |candidate: usize| {
            let mut gain = 0.0;
            if !cancellation.is_cancelled() {
                distances.each(&posed[candidate], |pose, d| gain += (nearest[pose] - d).max(0.0));
            }
            gain
        };
        let Some(best) = gains.best(least_gain, gain) else { break };
        chosen.push(poses[best]);
        distances.each(&posed[best], |pose, d| nearest[pose] = f64::min(nearest[pose], d));
    }
    chosen
}

/// The gains of all candidates. A choice can only lower the gain of the others, so a gain from an earlier round is an
/// upper bound. Most candidates need not be looked at again (lazy greedy, Minoux 1978).
struct Gains {
    bounds: Vec<f64>,
}

impl Gains {
    /// The candidate of largest gain, of equal ones the first; `None` if no gain is over `least`.
    fn best(&mut self, least: f64, gain: impl Fn(usize) -> f64 + Sync) -> Option<usize> {
        let mut order: Vec<usize> = (0..self.bounds.len()).collect();
        order.sort_by(|&a, &b| self.bounds[b].total_cmp(&self.bounds[a]).then(a.cmp(&b)));
        let mut best: Option<usize> = None;
        for some in order.chunks(AT_ONCE) {
            let largest = best.map_or(least, |best| self.bounds[best]);
            if self.bounds[some[0]] < largest {
                break;
            }
            let found: Vec<f64> = some.par_iter().map(|&candidate| gain(candidate)).collect();
            for (&candidate, gain) in some.iter().zip(found) {
                self.bounds[candidate] = gain;
                let is_better =
                    |best: usize| gain > self.bounds[best] || (gain == self.bounds[best] && candidate < best);
                if gain > least && best.is_none_or(is_better) {
                    best = Some(candidate);
                }
            }
        }
        best
    }
}

fn centred(mut points: Vec<Vec3>) -> Vec<Vec3> {
    let mean = points.iter().sum::<Vec3>() / points.len().max(1) as f32;
    points.iter_mut().for_each(|p| *p -= mean);
    points
}

#[cfg(test)]
mod tests {
    use glam::Mat4;

    use super::*;
    use crate::data::{Bone, Rig};

    /// Two bones at the origin, a vertex at x = 1 on each; the second bone turns about z by `angles`.
    fn model(angles: &[f32]) -> Model {
        let bone = |node| Bone { node, inverse_bind: Mat4::IDENTITY, rest_world: Mat4::IDENTITY };
        let pose = |(clip, &angle): (usize, &f32)| Pose {
            frame: Some((clip, 0.0)),
            world: vec![Mat4::IDENTITY, Mat4::from_rotation_z(angle)],
        };
        let surface = Surface {
            positions: vec![Vec3::X; 2],
            influences: vec![Influences::rigid(0), Influences::rigid(1)],
            ..Surface::default()
        };
        let poses = angles.iter().enumerate().map(pose).collect();
        let rig = Some(Rig { bones: vec![bone(0), bone(1)], source_skin: Some(0), poses });
        Model { surface, rig, ..Model::empty("hinge") }
    }

    #[test]
    fn poses_far_from_each_other_are_chosen_and_repeated_ones_are_not() {
        let model = model(&[0.0, 1.5, 0.0, 1.5, -1.5]);
        let blend = LinearBlend::of(&model).expect("bones");
        let chosen = representative(&blend, blend.poses(), &model.surface, 4, &Cancellation::default());
        assert_eq!(chosen.iter().map(|p| p.frame).collect::<Vec<_>>(), [Some((1, 0.0)), Some((4, 0.0))]);
        let poses = Poses::of(&model, 1, 4, &Cancellation::default()).expect("it moves");
        assert_eq!((poses.count(), poses.all()), (1, 2));
    }

    #[test]
    fn a_rig_without_clips_is_turned_at_its_joints() {
        let mut model = crate::animation::arm();
        model.surface.positions = (0..9).map(|i| Vec3::new(0.25 * i as f32, 0.1, 0.1)).collect();
        model.surface.influences = (0..9).map(|i| Influences::rigid(i / 4)).collect();
        let poses = Poses::of(&model, 2, 8, &Cancellation::default()).expect("it turns");
        // The elbow and the wrist, both ways.
        assert_eq!((poses.count(), poses.all()), (2, 4));
        let (rest, elbow) = (&model.surface.positions, poses.source_in(0));
        assert!(elbow[..4].iter().zip(rest).all(|(p, q)| p.distance(*q) < 1e-6));
        assert!(elbow[4..].iter().zip(&rest[4..]).all(|(p, q)| p.distance(*q) > 0.05));
    }

    #[test]
    fn the_largest_gain_is_found_without_looking_at_all() {
        let looked = std::sync::atomic::AtomicUsize::new(0);
        let found = |gains: &mut Gains, gain: &(dyn Fn(usize) -> f64 + Sync)| {
            looked.store(0, std::sync::atomic::Ordering::Relaxed);
            let best = gains.best(0.5, |candidate| {
                looked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                gain(candidate)
            });
            (best, looked.load(std::sync::atomic::Ordering::Relaxed))
        };
        let mut gains = Gains { bounds: vec![f64::INFINITY; 1000] };
        // Three candidates have the largest gain: the first one wins.
        assert_eq!(found(&mut gains, &|i| if i % 300 == 7 { 9.0 } else { (i % 7) as f64 }), (Some(7), 1000));
        assert_eq!(found(&mut gains, &|i| if i == 7 { 0.0 } else { (i % 7) as f64 }), (Some(6), 192));
        assert_eq!(found(&mut gains, &|_| 0.5).0, None);
    }

    #[test]
    fn clips_that_move_nothing_give_no_poses() {
        let model = model(&[0.0, 0.0]);
        assert!(Poses::of(&model, 4, 4, &Cancellation::default()).is_none());
    }

    #[test]
    fn a_vertex_on_two_bones_goes_half_the_way() {
        let model = model(&[std::f32::consts::PI]);
        let poses = Poses::of(&model, 1, 1, &Cancellation::default()).expect("it moves");
        let half = Influences { joints: [1, 0, 0, 0], weights: [0.5, 0.5, 0.0, 0.0] };
        let mesh = TriMesh { positions: vec![Vec3::X; 2], triangles: Vec::new() };
        let posed = poses.posed(&mesh, &poses.motions(&[Influences::rigid(1), half])).next().expect("a pose");
        assert!(posed.positions[0].distance(-Vec3::X) < 1e-6 && posed.positions[1].length() < 1e-6);
    }
}
