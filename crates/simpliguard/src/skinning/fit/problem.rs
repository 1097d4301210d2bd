//! The minimisation of the error over the weights.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::samples::{PoseError, Samples};
use crate::animation::{Poses, ordered, project};
use crate::data::{Influences, TriMesh};

/// Steps of the optimisation.
const STEPS: usize = 100;
/// Pull of the weights towards those at the start, relative to the largest curvature of the error at their vertex.
const PULL: f32 = 1e-3;

/// The error as a quadratic function of the weights, around those at the start.
pub(super) struct Problem {
    poses: usize,
    /// Derivative of the position of each vertex in each pose by each of its weights.
    by_weights: Vec<[Vec3; 4]>,
    /// Half the gradient at the start, by the position of each vertex in each pose.
    start: Vec<Vec3>,
    /// See [`Samples::gram`].
    gram: Vec<Vec<(u32, f32)>>,
    /// Bound of the curvature along the weights of each vertex.
    steepness: Vec<f32>,
}

impl Problem {
    /// The problem around `influences`, whose errors are `start`.
    pub(super) fn new(
        poses: &Poses<'_>,
        mesh: &TriMesh,
        influences: &[Influences],
        samples: &Samples,
        start: &[PoseError],
    ) -> Self {
        let n = poses.all();
        let gram = samples.gram(influences.len());
        let by_weights: Vec<[Vec3; 4]> = (0..n * influences.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let own = &influences[i / n];
                let derivatives = poses.by_weights(i % n, own, mesh.positions[i / n]);
                std::array::from_fn(|k| if own.weights[k] > 0.0 { derivatives[k] } else { Vec3::ZERO })
            })
            .collect();
        let steepness = gram.iter().zip(by_weights.chunks(n)).map(|(row, derivatives)| {
            let reach: f32 = derivatives.iter().flatten().map(|d| d.length_squared()).sum();
            row.iter().map(|(_, product)| product).sum::<f32>() * reach
        });
        let steepness = steepness.collect();
        let start = (0..n * influences.len()).map(|i| start[i % n].half_gradient[i / n]).collect();
        Self { poses: n, by_weights, start, gram, steepness }
    }

    /// The influences after [`STEPS`] steps, strongest first.
    pub(super) fn solve(&self, influences: &[Influences]) -> Vec<Influences> {
        let origin: Vec<Vec4> = influences.iter().map(|i| i.weights.into()).collect();
        let slots: Vec<usize> = influences.iter().map(|i| i.weights.iter().filter(|w| **w > 0.0).count()).collect();
        let (mut weights, mut ahead, mut momentum) = (origin.clone(), origin.clone(), 1.0f32);
        for _ in 0..STEPS {
            let displacements = self.displacements(&ahead, &origin);
            let next: Vec<Vec4> = (0..origin.len())
                .into_par_iter()
                .with_min_len(256)
                .map(|v| {
                    let steepness = self.steepness[v];
                    if slots[v] < 2 || steepness <= 0.0 {
                        return origin[v];
                    }
                    let pull = (ahead[v] - origin[v]) * PULL;
                    let step = self.gradient(v, &displacements) / steepness + pull;
                    let mut stepped = (ahead[v] - step / (1.0 + PULL)).to_array();
                    project(&mut stepped[..slots[v]]);
                    stepped.into()
                })
                .collect();
            let larger = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
            let inertia = (momentum - 1.0) / larger;
            ahead = next.iter().zip(&weights).map(|(next, last)| *next + (*next - *last) * inertia).collect();
            (weights, momentum) = (next, larger);
        }
        let with = |(i, w): (&Influences, &Vec4)| ordered(&Influences { joints: i.joints, weights: w.to_array() });
        influences.iter().zip(&weights).map(with).collect()
    }

    /// Displacement of each vertex in each pose by the change of its weights from `origin`.
    fn displacements(&self, weights: &[Vec4], origin: &[Vec4]) -> Vec<Vec3> {
        let along = |(i, derivatives): (usize, &[Vec3; 4])| {
            let change = (weights[i / self.poses] - origin[i / self.poses]).to_array();
            derivatives.iter().zip(change).map(|(d, change)| *d * change).sum()
        };
        self.by_weights.par_iter().with_min_len(1024).enumerate().map(along).collect()
    }

    /// Half the gradient by the weights of a vertex.
    fn gradient(&self, v: usize, displacements: &[Vec3]) -> Vec4 {
        let mut gradient = Vec4::ZERO;
        for pose in 0..self.poses {
            let around =
                self.gram[v].iter().map(|&(u, product)| displacements[u as usize * self.poses + pose] * product);
            let by_position = self.start[v * self.poses + pose] + around.sum::<Vec3>();
            gradient += Vec4::from(self.by_weights[v * self.poses + pose].map(|d| d.dot(by_position)));
        }
        gradient
    }
}
