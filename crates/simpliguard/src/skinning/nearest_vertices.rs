//! Influences of the nearest vertices of the source (SimpliGuard, section 3.5).

use glam::Vec3;
use rayon::prelude::*;

use crate::animation::Weights;
use crate::data::{Influences, Surface};
use crate::geometry::KdTree;

/// Influences at each position: `BW(i) = sum_j (1 - d_ij / sum_k d_ik) BW(j)` over the `k` nearest vertices `j`. The
/// paper's factors sum to `k - 1`; they are normalised here.
pub(super) fn transfer(surface: &Surface, positions: &[Vec3], k: usize) -> Vec<Influences> {
    let tree = KdTree::new(&surface.positions);
    positions
        .par_iter()
        .map(|&position| {
            let nearest = tree.nearest(position, k.max(1));
            let sum: f32 = nearest.iter().map(|(d, _)| d).sum();
            let mut weights = Weights::default();
            for &(distance, vertex) in &nearest {
                // A single neighbour, or neighbours at distance zero, share equally.
                let factor = if nearest.len() == 1 || sum <= 0.0 { 1.0 } else { 1.0 - distance / sum };
                weights.add(&surface.influences[vertex as usize], factor);
            }
            weights.strongest()
        })
        .collect()
}
