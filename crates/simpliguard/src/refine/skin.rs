//! Skin weights, fitted to the posed views together with the vertices.
//!
//! Linear blend skinning takes a vertex from `p` at rest to `P R^-1 p`, with `P` and `R` the blends of its bones' matrices
//! in the pose and at rest. Its derivative by a weight ([`Poses::by_weights`]) carries the gradient at the posed vertex
//! on to the weights. Each vertex keeps its initial bones. Projected gradient descent on the simplex keeps weights positive
//! and their sum at one.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::low_poly::LowPoly;
use super::optimizer::Adam;
use crate::animation::{Poses, ordered, project};
use crate::data::Influences;

/// Weight, in the loss, of the squared change of each skin weight, over the number of vertices.
const PULL: f32 = 0.01;

/// Bones and weights of a level's vertices during the optimisation.
pub struct Skin<'a> {
    poses: &'a Poses<'a>,
    influences: Vec<Influences>,
    /// Initial weights.
    origin: Vec<[f32; 4]>,
    /// Number of bones that each vertex may follow.
    slots: Vec<u8>,
}

/// The gradient at the vertices of one view.
pub(super) struct PosedGradient<'a> {
    /// Pose of the view; `None` for the rest pose.
    pub(super) pose: Option<usize>,
    /// By the posed positions, in world space.
    pub(super) posed: &'a [Vec3],
    /// Weight of the view.
    pub(super) factor: f32,
}

impl<'a> Skin<'a> {
    /// Begins with `influences`, as transferred from the source.
    pub fn new(poses: &'a Poses<'a>, influences: Vec<Influences>) -> Self {
        let slots = influences.iter().map(|i| i.weights.iter().filter(|w| **w > 0.0).count() as u8).collect();
        Self { poses, origin: influences.iter().map(|i| i.weights).collect(), influences, slots }
    }

    /// The present influences of each vertex, the largest weight first.
    pub fn into_influences(self) -> Vec<Influences> {
        self.influences.iter().map(ordered).collect()
    }

    /// The present weights of each vertex.
    pub(super) fn weights(&self) -> Vec<[f32; 4]> {
        self.influences.iter().map(|i| i.weights).collect()
    }

    /// Replaces the weights of each vertex.
    pub(super) fn set_weights(&mut self, weights: &[[f32; 4]]) {
        self.influences.iter_mut().zip(weights).for_each(|(i, w)| i.weights = *w);
    }

    /// Brings the motions of `low` into `pose` up to date.
    pub(super) fn move_into(&self, pose: Option<usize>, low: &mut LowPoly) {
        if let Some(pose) = pose {
            low.motions.set(pose, self.poses.motions_into(pose, &self.poses.bind(&self.influences)));
        }
    }

    /// Brings all motions of `low` up to date.
    pub(super) fn move_into_all(&self, low: &mut LowPoly) {
        low.motions = self.poses.all_motions(&self.influences);
    }

    /// Adds the gradient by the weights that follows from `view`, with the vertices at `positions` in the rest pose.
    pub(super) fn add_gradient(&self, view: &PosedGradient<'_>, positions: &[Vec3], gradient: &mut [Vec4]) {
        let PosedGradient { pose, posed, factor } = *view;
        let Some(pose) = pose else { return };
        let vertices = gradient.par_iter_mut().zip(&self.influences).zip(positions).zip(posed).zip(&self.slots);
        vertices.with_min_len(256).for_each(|((((gradient, influences), position), posed), &slots)| {
            if slots > 1 && *posed != Vec3::ZERO {
                let by_weights = self.poses.by_weights(pose, influences, *position);
                *gradient += Vec4::from(by_weights.map(|d| d.dot(*posed))) * factor;
            }
        });
    }

    /// Moves the weights against `gradient` by about `rate` each, and projects them back onto the simplex.
    pub(super) fn step(&mut self, adam: &mut Adam, mut gradient: Vec<Vec4>, rate: f32) {
        let pull = 2.0 * PULL / self.influences.len().max(1) as f32;
        for (((gradient, influences), origin), &slots) in
            gradient.iter_mut().zip(&self.influences).zip(&self.origin).zip(&self.slots)
        {
            *gradient += (Vec4::from(influences.weights) - Vec4::from(*origin)) * pull;
            // Only the component that shifts weight between the bones counts.
            let slots = usize::from(slots);
            let mean = (0..slots).map(|k| gradient[k]).sum::<f32>() / slots.max(1) as f32;
            (0..4).for_each(|k| gradient[k] = if k < slots { gradient[k] - mean } else { 0.0 });
        }
        let mut weights = self.weights();
        adam.step(weights.as_flattened_mut(), bytemuck::cast_slice(&gradient), rate);
        for ((influences, weights), &slots) in self.influences.iter_mut().zip(&mut weights).zip(&self.slots) {
            project(&mut weights[..usize::from(slots)]);
            influences.weights = *weights;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat4;

    use super::*;
    use crate::Cancellation;
    use crate::data::{Bone, Model, Pose, Rig, Surface};

    /// A bone that stays, and one that a clip lifts by one along y.
    fn lift() -> Model {
        let bone = |node| Bone { node, inverse_bind: Mat4::IDENTITY, rest_world: Mat4::IDENTITY };
        let world = vec![Mat4::IDENTITY, Mat4::from_translation(Vec3::Y)];
        let poses = vec![Pose { frame: Some((0, 0.0)), world }];
        let surface = Surface {
            positions: vec![Vec3::ZERO, Vec3::X],
            influences: vec![Influences::rigid(0), Influences::rigid(1)],
            ..Surface::default()
        };
        let rig = Some(Rig { bones: vec![bone(0), bone(1)], source_skin: Some(0), poses });
        Model { surface, rig, ..Model::empty("lift") }
    }

    #[test]
    fn weights_go_where_the_posed_vertex_is_wanted_and_stay_on_their_bones() {
        let model = lift();
        let poses = Poses::of(&model, 1, 1, &Cancellation::default()).expect("it moves");
        let half = Influences { joints: [0, 1, 0, 0], weights: [0.5, 0.5, 0.0, 0.0] };
        let mut skin = Skin::new(&poses, vec![half, Influences::rigid(1)]);
        let mut adam = Adam::new(8);
        // The loss pulls the first vertex to a height of 0.8 in the pose.
        for _ in 0..400 {
            let heights = poses.motions_into(0, &poses.bind(&skin.influences));
            let posed: Vec<Vec3> = heights.iter().map(|m| Vec3::Y * 2.0 * (m.translation.y - 0.8)).collect();
            let mut gradient = vec![Vec4::ZERO; 2];
            let posed = PosedGradient { pose: Some(0), posed: &posed, factor: 1.0 };
            skin.add_gradient(&posed, &model.surface.positions, &mut gradient);
            skin.step(&mut adam, gradient, 0.01);
        }
        let fitted = skin.into_influences();
        assert_eq!((fitted[0].joints, fitted[1]), ([1, 0, 0, 0], Influences::rigid(1)));
        assert!((fitted[0].weights[0] - 0.8).abs() < 0.02, "{:?}", fitted[0]);
        assert!((fitted[0].weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    }
}
