//! Removal of faces that no later stage can use: not finite, too far away, degenerate or duplicate.

use glam::{DVec3, Vec3};

use super::asset::{Asset, counted};
use crate::data::{Influences, SMALLEST_EXTENT, Surface};
use crate::geometry::{first_equal, position_bits};
use crate::{Error, StageId};

/// Largest coordinate, in metres. Beyond it the squares of areas leave the range of `f32`.
const FARTHEST: f32 = 1e9;

/// Numbers of faces that were dropped, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// A corner is NaN or infinite.
    pub(super) not_finite: usize,
    /// A corner is beyond a million kilometres.
    pub(super) too_far: usize,
    /// Two corners coincide, or the area is zero.
    pub(super) degenerate: usize,
    /// Same corners in the same direction, with the same material and the same bones as an earlier face.
    pub(super) duplicate: usize,
}

/// Drops unusable faces, and vertices without a face.
///
/// # Errors
/// [`Error::Invalid`] if no face is left and positions are the cause.
pub(super) fn clean(asset: Asset<'_>, surface: &mut Surface) -> Result<Dropped, Error> {
    let faces = surface.triangles.len();
    let mut dropped = Dropped::default();
    // The squares of areas of a tiny model vanish in `f32`. It gets no levels, but is a valid source.
    let tiny = surface.extent() < SMALLEST_EXTENT;
    let positions = &surface.positions;
    let mut keep: Vec<bool> = Vec::with_capacity(surface.triangles.len());
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        let finite = [a, b, c].iter().all(|p| p.is_finite());
        let near = finite && [a, b, c].iter().all(|p| p.abs().max_element() <= FARTHEST);
        let degenerate = near && has_no_area(b - a, c - a, tiny);
        dropped.not_finite += usize::from(!finite);
        dropped.too_far += usize::from(finite && !near);
        dropped.degenerate += usize::from(degenerate);
        keep.push(near && !degenerate);
    }
    asset.check()?;
    dropped.duplicate = mark_duplicates(asset, surface, &mut keep)?;
    asset.check()?;
    retain(surface, &keep);
    dropped.check(asset, faces)?;
    Ok(dropped)
}

impl Dropped {
    /// Notes for the report.
    pub(super) fn notes(self) -> Vec<String> {
        counted(&[
            (self.not_finite, "faces with corners that are not finite are dropped"),
            (self.too_far, "faces with corners over 1e9 metres from the origin are dropped"),
            (self.degenerate, "degenerate faces are dropped"),
            (self.duplicate, "duplicate faces are dropped"),
        ])
    }

    /// `Err` if none of `faces` faces is left, and some of them had unusable positions.
    fn check(self, asset: Asset<'_>, faces: usize) -> Result<(), Error> {
        let unusable = self.not_finite + self.too_far;
        if unusable == 0 || unusable + self.degenerate < faces {
            return Ok(());
        }
        let counts = [
            (self.not_finite, "have corners that are not finite".to_owned()),
            (self.too_far, format!("have corners over {FARTHEST:e} metres from the origin")),
            (self.degenerate, "have no area".to_owned()),
        ];
        let counted = counts.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let reasons: Vec<String> = counted.collect();
        let found = format!("none of its {faces} faces can be used: {}", reasons.join(", "));
        let advice = "check its positions and the scales of its nodes, and export it again";
        Err(Error::invalid(asset.name, StageId::Import, found, advice))
    }
}

fn has_no_area(u: Vec3, v: Vec3, tiny: bool) -> bool {
    match tiny {
        true => u.as_dvec3().cross(v.as_dvec3()) == DVec3::ZERO,
        false => u.cross(v).length_squared() == 0.0,
    }
}

/// Clears `keep` for every face that repeats an earlier one; returns their number.
fn mark_duplicates(asset: Asset<'_>, surface: &Surface, keep: &mut [bool]) -> Result<usize, Error> {
    let welded = first_equal(surface.positions.len(), |vertex| {
        let bones = surface.influences.get(vertex).map(bone_bits);
        (position_bits(surface.positions[vertex]), bones)
    });
    asset.check()?;
    let first = first_equal(surface.triangles.len(), |face| {
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
    Ok(duplicates)
}

fn bone_bits(influences: &Influences) -> ([u16; 4], [u32; 4]) {
    (influences.joints, influences.weights.map(f32::to_bits))
}

/// A face's corners, rotated so that the lowest comes first.
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
    for target in surface.morphs.iter_mut().flat_map(|morphs| &mut morphs.targets) {
        target.displacements.retain(|(vertex, _)| used[*vertex as usize]);
        target.displacements.iter_mut().for_each(|(vertex, _)| *vertex = number[*vertex as usize]);
    }
    retain_marked(&mut surface.positions, &used);
    retain_marked(&mut surface.normals, &used);
    retain_marked(&mut surface.tangents, &used);
    surface.uvs.iter_mut().for_each(|uvs| retain_marked(uvs, &used));
    retain_marked(&mut surface.colors, &used);
    retain_marked(&mut surface.painted, &used);
    retain_marked(&mut surface.influences, &used);
}

/// Keeps the items whose mark is set; an empty list stays empty.
fn retain_marked<T>(items: &mut Vec<T>, marks: &[bool]) {
    let mut marks = marks.iter();
    items.retain(|_| marks.next().copied().unwrap_or_default());
}
