//! Fewer triangles of a primitive, for a source that is only looked at.

use std::collections::BTreeMap;

use meshopt::{SimplifyOptions, VertexDataAdapter, simplify, simplify_sloppy};

/// Largest error, relative to the extent of the primitive: none, since the number of triangles decides.
const ANY_ERROR: f32 = 1.0;
/// A result with more than this times the wanted triangles is made again by a means that asks for less.
const FAR_OFF: usize = 2;

/// Triangles for about `target` of them, as indices of the same vertices. Seams of attributes are kept where that leaves few
/// enough triangles.
pub(super) fn decimate(positions: &[[f32; 3]], indices: &[u32], target: usize) -> Vec<u32> {
    let is_usable = indices.iter().all(|&i| (i as usize) < positions.len());
    if indices.len() / 3 <= target || !is_usable {
        return indices.to_vec();
    }
    let bytes: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let Ok(vertices) = VertexDataAdapter::new(&bytes, 12, 0) else { return indices.to_vec() };
    let whole = &indices[..indices.len() / 3 * 3];
    let fits = |found: &Vec<u32>| found.len() / 3 <= FAR_OFF * target;
    let collapse = |options| simplify(whole, &vertices, 3 * target, ANY_ERROR, options, None);
    let kept = collapse(SimplifyOptions::None);
    if fits(&kept) {
        return kept;
    }
    // Loose cards, as leaves are, have nothing to collapse: some of them go.
    let pruned = collapse(SimplifyOptions::Permissive | SimplifyOptions::Prune);
    if fits(&pruned) {
        return pruned;
    }
    simplify_sloppy(whole, &vertices, 3 * target, ANY_ERROR, None)
}

/// The vertices that indices use, in the order of their first use, and the indices into these.
pub(super) fn compact(indices: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut kept, mut new) = (Vec::new(), BTreeMap::new());
    let renumber = |&old: &u32| {
        *new.entry(old).or_insert_with(|| {
            kept.push(old);
            kept.len() as u32 - 1
        })
    };
    let indices = indices.iter().map(renumber).collect();
    (kept, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat square of `n` x `n` cells.
    fn grid(n: u32) -> (Vec<[f32; 3]>, Vec<u32>) {
        let side = n + 1;
        let positions = (0..side * side).map(|i| [(i % side) as f32, (i / side) as f32, 0.0]).collect();
        let cell = |i: u32| {
            let corner = i / n * side + i % n;
            [corner, corner + 1, corner + side, corner + 1, corner + side + 1, corner + side]
        };
        (positions, (0..n * n).flat_map(cell).collect())
    }

    #[test]
    fn a_plane_is_decimated_and_small_or_broken_ones_stay() {
        let (positions, indices) = grid(20);
        let found = decimate(&positions, &indices, 50);
        assert!(!found.is_empty() && found.len() <= 3 * 100, "{}", found.len());
        assert_eq!(decimate(&positions, &indices, 800), indices);
        let broken = [indices, vec![0, 1, 99_999]].concat();
        assert_eq!(decimate(&positions, &broken, 50), broken);
    }

    #[test]
    fn loose_triangles_get_fewer() {
        let corner =
            |i: u32| [(i / 3) as f32 + (i % 3 == 1) as u32 as f32 * 0.5, (i % 3 == 2) as u32 as f32 * 0.5, 0.0];
        let positions: Vec<[f32; 3]> = (0..3000).map(corner).collect();
        let indices: Vec<u32> = (0..3000).collect();
        assert!(decimate(&positions, &indices, 100).len() <= 3 * 200);
    }

    #[test]
    fn vertices_are_numbered_anew_by_first_use() {
        assert_eq!(compact(&[7, 3, 7, 9]), (vec![7, 3, 9], vec![0, 1, 0, 2]));
    }
}
