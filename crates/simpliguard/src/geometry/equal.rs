//! Vertices with equal keys, bit by bit.

use std::hash::{DefaultHasher, Hash, Hasher as _};

use glam::Vec3;
use rayon::prelude::*;

/// The lowest vertex with an equal key, for each of `count` vertices.
pub(crate) fn first_equal<K: Ord + Hash>(count: usize, key: impl Fn(usize) -> K + Sync) -> Vec<u32> {
    // Sorted by half of a hash, then by number. Keys decide wherever two hashes are equal.
    let hashed = |vertex: u32| hash(&key(vertex as usize)) << 32 | u64::from(vertex);
    let mut order: Vec<u64> = (0..count as u32).into_par_iter().map(hashed).collect();
    order.par_sort_unstable();
    let mut first = vec![0; count];
    for run in order.chunk_by_mut(|a, b| a >> 32 == b >> 32) {
        let lowest = key(run[0] as u32 as usize);
        if run[1..].iter().any(|&vertex| key(vertex as u32 as usize) != lowest) {
            run.sort_unstable_by_key(|&vertex| (key(vertex as u32 as usize), vertex));
        }
        for equal in run.chunk_by(|&a, &b| key(a as u32 as usize) == key(b as u32 as usize)) {
            equal.iter().for_each(|&vertex| first[vertex as u32 as usize] = equal[0] as u32);
        }
    }
    first
}

/// The lowest vertex in the place of each vertex.
pub(crate) fn first_coincident(positions: &[Vec3]) -> Vec<u32> {
    first_equal(positions.len(), |v| position_bits(positions[v]))
}

fn hash(key: &impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    hasher.finish()
}

/// A position as a key; positive and negative zero are equal.
pub(crate) fn position_bits(position: Vec3) -> [u32; 3] {
    (position + 0.0).to_array().map(f32::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A key whose hash is the same for all.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    struct Colliding(u32);

    impl Hash for Colliding {
        fn hash<H: std::hash::Hasher>(&self, _: &mut H) {}
    }

    #[test]
    fn the_lowest_equal_vertex_is_found_whatever_the_hashes() {
        let keys = [5, 3, 5, 7, 3, 3];
        let expected = [0, 1, 0, 3, 1, 1];
        assert_eq!(first_equal(6, |vertex| keys[vertex]), expected);
        assert_eq!(first_equal(6, |vertex| Colliding(keys[vertex])), expected);
        assert!(first_equal(0, |vertex| vertex).is_empty());
    }
}
