//! Vertices with equal keys, bit by bit.

use glam::Vec3;
use rayon::slice::ParallelSliceMut as _;

/// The lowest vertex with an equal key, for each of `count` vertices.
pub(crate) fn first_equal<K: Ord + Send>(count: usize, key: impl Fn(usize) -> K + Sync) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    order.par_sort_unstable_by(|&a, &b| key(a as usize).cmp(&key(b as usize)).then(a.cmp(&b)));
    let mut first = vec![0; count];
    for run in order.chunk_by(|&a, &b| key(a as usize) == key(b as usize)) {
        for &vertex in run {
            first[vertex as usize] = run[0];
        }
    }
    first
}

/// A position as a key; positive and negative zero are equal.
pub(crate) fn position_bits(position: Vec3) -> [u32; 3] {
    (position + 0.0).to_array().map(f32::to_bits)
}
