//! The texels that the faces of an atlas cover.

use glam::{DVec2, Vec2};

use crate::data::Atlas;
use crate::geometry::doubled_area;

/// Calls `hit(x, y)` for every texel of a `size * size` raster whose centre lies in the triangle. A centre on a side
/// shared by two triangles of equal orientation belongs to exactly one of them (top-left rule).
pub(super) fn texels(uv: &[Vec2; 3], size: u32, mut hit: impl FnMut(u32, u32)) {
    let mut t = uv.map(|p| p.as_dvec2() * f64::from(size));
    let doubled = doubled_area(&t);
    if doubled == 0.0 || !doubled.is_finite() {
        return;
    }
    if doubled < 0.0 {
        t.swap(1, 2);
    }
    let (low, high) = (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
    let range = |low: f64, high: f64| {
        let clamp = |v: f64| v.clamp(0.0, f64::from(size)) as u32;
        clamp((low - 0.5).ceil())..clamp((high - 0.5).floor() + 1.0)
    };
    for y in range(low.y, high.y) {
        for x in range(low.x, high.x) {
            let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if (0..3).all(|k| is_inside(t[k], t[(k + 1) % 3], p)) {
                hit(x, y);
            }
        }
    }
}

/// True if `p` is left of the line from `a` to `b`, or on the line and the line is a top or left side. Both triangles
/// at an edge compute the same number.
fn is_inside(a: DVec2, b: DVec2, p: DVec2) -> bool {
    let reversed = (b.y, b.x) < (a.y, a.x);
    let (from, to) = if reversed { (b, a) } else { (a, b) };
    let e = (to - from).perp_dot(p - from);
    let e = if reversed { -e } else { e };
    e > 0.0 || (e == 0.0 && !reversed)
}

/// Number of texels of a `size * size` raster whose centre lies in more than one face.
pub fn overlaps(atlas: &Atlas, size: u32) -> usize {
    counts(&atlas.uvs, size).into_iter().filter(|&n| n > 1).count()
}

/// Number of faces without positive area in the atlas: flipped or collapsed.
pub fn flips(atlas: &Atlas) -> usize {
    let area = |t: &&[Vec2; 3]| doubled_area(&t.map(|p| p.as_dvec2()));
    atlas.uvs.iter().filter(|t| area(t).is_nan() || area(t) <= 0.0).count()
}

/// Fraction of all texels whose centre lies in a face.
pub(super) fn fill(uvs: &[[Vec2; 3]], size: u32) -> f32 {
    let counts = counts(uvs, size);
    counts.iter().filter(|&&n| n > 0).count() as f32 / counts.len().max(1) as f32
}

/// Number of faces at the centre of each texel, at most 255.
fn counts(uvs: &[[Vec2; 3]], size: u32) -> Vec<u8> {
    let mut counts = vec![0u8; size as usize * size as usize];
    for uv in uvs {
        texels(uv, size, |x, y| {
            let slot = &mut counts[y as usize * size as usize + x as usize];
            *slot = slot.saturating_add(1);
        });
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_halves_of_a_square_cover_each_texel_once() {
        let [a, b, c, d] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let counts = counts(&[[a, b, c], [a, c, d]], 8);
        assert!(counts.iter().all(|&n| n == 1));
    }

    #[test]
    fn a_fan_around_a_texel_centre_covers_it_once() {
        let rim = [Vec2::new(0.1, 0.1), Vec2::new(0.9, 0.1), Vec2::new(0.9, 0.9), Vec2::new(0.1, 0.9)];
        let fan: Vec<[Vec2; 3]> = (0..4).map(|i| [Vec2::splat(0.5), rim[i], rim[(i + 1) % 4]]).collect();
        assert!(counts(&fan, 9).iter().all(|&n| n <= 1));
        assert_eq!(counts(&fan, 9)[4 * 9 + 4], 1);
    }

    #[test]
    fn both_orientations_cover_the_same_interior() {
        let t = [Vec2::new(0.13, 0.07), Vec2::new(0.91, 0.33), Vec2::new(0.29, 0.87)];
        assert_eq!(counts(&[t], 32), counts(&[[t[0], t[2], t[1]]], 32));
    }
}
