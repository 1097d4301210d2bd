//! Faces that no later stage can use: not finite, degenerate, duplicate.

use super::weld;
use crate::model::{Influences, Surface};

/// Positions beyond this are as bad as infinite ones: their squares leave the range of `f32`. Metres.
const FARTHEST: f32 = 1e9;

/// Faces that were dropped, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// A corner is NaN, infinite or beyond a million kilometres.
    pub(super) not_finite: usize,
    /// Two corners coincide, or the area is zero.
    pub(super) degenerate: usize,
    /// Same corners in the same direction, of the same material and on the same bones as an earlier face.
    pub(super) duplicate: usize,
}

/// Drops unusable faces, and the vertices that nothing refers to any more.
pub(super) fn clean(surface: &mut Surface) -> Dropped {
    let mut dropped = Dropped::default();
    let positions = &surface.positions;
    let mut keep: Vec<bool> = Vec::with_capacity(surface.triangles.len());
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        let finite = [a, b, c].iter().all(|p| p.is_finite() && p.abs().max_element() <= FARTHEST);
        let degenerate = finite && (b - a).cross(c - a).length_squared() == 0.0;
        dropped.not_finite += usize::from(!finite);
        dropped.degenerate += usize::from(degenerate);
        keep.push(finite && !degenerate);
    }
    dropped.duplicate = mark_duplicates(surface, &mut keep);
    retain(surface, &keep);
    dropped
}

/// Clears `keep` of every face that repeats an earlier one.
fn mark_duplicates(surface: &Surface, keep: &mut [bool]) -> usize {
    let welded = weld::by(surface.positions.len(), |vertex| {
        let bones = surface.influences.get(vertex).map(bone_bits);
        (weld::position_bits(surface.positions[vertex]), bones)
    });
    let first = weld::by(surface.triangles.len(), |face| {
        let corners = surface.triangles[face].map(|vertex| welded[vertex as usize]);
        (from_lowest(corners), surface.material[face], !keep[face])
    });
    let mut duplicates = 0;
    for (face, &first) in first.iter().enumerate() {
        if keep[face] && first as usize != face {
            keep[face] = false;
            duplicates += 1;
        }
    }
    duplicates
}

fn bone_bits(influences: &Influences) -> ([u16; 4], [u32; 4]) {
    (influences.joints, influences.weights.map(f32::to_bits))
}

/// A face's corners from the lowest on, direction kept.
fn from_lowest(corners: [u32; 3]) -> [u32; 3] {
    let [a, b, c] = corners;
    if a <= b && a <= c {
        [a, b, c]
    } else if b <= c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Keeps the marked faces and their vertices, in order.
fn retain(surface: &mut Surface, keep: &[bool]) {
    let mut used = vec![false; surface.positions.len()];
    for (triangle, _) in surface.triangles.iter().zip(keep).filter(|(_, keep)| **keep) {
        triangle.iter().for_each(|&vertex| used[vertex as usize] = true);
    }
    retain_marked(&mut surface.triangles, keep);
    retain_marked(&mut surface.material, keep);
    if used.iter().all(|&used| used) {
        return;
    }
    let mut number = Vec::with_capacity(used.len());
    let mut next = 0u32;
    for &used in &used {
        number.push(next);
        next += u32::from(used);
    }
    surface.triangles.iter_mut().flatten().for_each(|vertex| *vertex = number[*vertex as usize]);
    retain_marked(&mut surface.positions, &used);
    retain_marked(&mut surface.normals, &used);
    retain_marked(&mut surface.tangents, &used);
    surface.uvs.iter_mut().for_each(|uvs| retain_marked(uvs, &used));
    retain_marked(&mut surface.colors, &used);
    retain_marked(&mut surface.influences, &used);
}

/// Keeps the items whose mark is set; an empty list stays empty.
fn retain_marked<T>(items: &mut Vec<T>, marks: &[bool]) {
    let mut marks = marks.iter();
    items.retain(|_| marks.next().copied().unwrap_or_default());
}
