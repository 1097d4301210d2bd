//! Influences of the nearest source vertices, SimpliGuard section 3.5.

use glam::Vec3;
use rayon::prelude::*;

use crate::animation::Weights;
use crate::data::{Influences, Surface};
use crate::geometry::KdTree;

/// `BW(i) = sum_j (1 - d_ij / sum_k d_ik) BW(j)` over the `k` nearest vertices `j`. The factors sum to `k - 1`; they
/// are normalised here.
pub(super) fn transfer(surface: &Surface, positions: &[Vec3], k: usize) -> Vec<Influences> {
    let tree = KdTree::new(&surface.positions);
    positions
        .par_iter()
        .map(|&position| {
            let nearest = tree.nearest(position, k.max(1));
            let sum: f32 = nearest.iter().map(|(d, _)| d).sum();
            let mut weights = Weights::default();
            for &(distance, vertex) in &nearest {
                // One neighbour, or all at no distance: equal parts.
                let factor = if nearest.len() == 1 || sum <= 0.0 { 1.0 } else { 1.0 - distance / sum };
                weights.add(&surface.influences[vertex as usize], factor);
            }
            weights.strongest()
        })
        .collect()
}
