//! Which point of the mesh each texel stands for.

use glam::{Vec2, Vec3, Vec4};

use super::GUTTER_STEPS;
use crate::data::Atlas;
use crate::render::raster::scan;

/// A texel whose centre lies in a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric coordinates of the texel's centre.
    pub barycentric: Vec3,
}

/// The triangle under the centre of each texel, rows from the top.
pub fn texel_map(atlas: &Atlas, size: usize) -> Vec<Option<Texel>> {
    let mut map = vec![None; size * size];
    for (t, corners) in atlas.uvs.iter().enumerate() {
        // Texel centres lie at halves; the scan has them at whole numbers.
        let [a, b, c] = corners.map(|uv| uv * size as f32 - Vec2::splat(0.5));
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 {
            continue;
        }
        scan(&[a, b, c].map(|p| p.extend(0.0)), size, |y, x0, x1| {
            for x in x0..x1 {
                let p = Vec2::new(x as f32, y as f32);
                let u = (b - p).perp_dot(c - p) / area;
                let v = (c - p).perp_dot(a - p) / area;
                let barycentric = Vec3::new(u, v, 1.0 - u - v);
                map[y * size + x] = Some(Texel { triangle: t as u32, barycentric });
            }
        });
    }
    map
}

/// Gives unknown texels the mean of their known neighbours, ring by ring, `steps` times.
pub fn dilate(texels: &mut [Vec4], known: &mut [bool], size: usize, steps: usize) {
    let mut front: Vec<usize> = (0..texels.len()).filter(|&i| !known[i]).collect();
    for _ in 0..steps {
        let mut filled = Vec::new();
        front.retain(|&i| {
            let (mut sum, mut count) = (Vec4::ZERO, 0.0);
            for j in neighbours(i, size).filter(|&j| known[j]) {
                sum += texels[j];
                count += 1.0;
            }
            if count > 0.0 {
                filled.push((i, sum / count));
            }
            count == 0.0
        });
        if filled.is_empty() {
            return;
        }
        for (i, value) in filled {
            texels[i] = value;
            known[i] = true;
        }
    }
}

/// Gives every unknown texel a value: rings around the charts first, far ones the mean of what lies around them at
/// coarser and coarser scales, so that no mip level takes in anything foreign.
pub fn fill(texels: &mut [Vec4], known: &[bool], size: usize) {
    let mut known = known.to_vec();
    dilate(texels, &mut known, size, GUTTER_STEPS);
    let weighted = texels.iter().zip(&known).map(|(t, k)| if *k { (*t, 1.0) } else { (Vec4::ZERO, 0.0) }).collect();
    let mut levels: Vec<(usize, Vec<(Vec4, f32)>)> = vec![(size, weighted)];
    while let Some((side, fine)) = levels.last().filter(|(side, _)| *side > 1) {
        let half = side / 2;
        let mean = |i: usize| {
            let (x, y) = (2 * (i % half), 2 * (i / half));
            let four = [y * side + x, y * side + x + 1, (y + 1) * side + x, (y + 1) * side + x + 1].map(|j| fine[j]);
            let weight: f32 = four.iter().map(|f| f.1).sum();
            let sum: Vec4 = four.iter().map(|f| f.0 * f.1).sum();
            if weight > 0.0 { (sum / weight, 1.0) } else { (Vec4::ZERO, 0.0) }
        };
        levels.push((half, (0..half * half).map(mean).collect()));
    }
    while let Some((half, coarse)) = levels.pop() {
        let Some((side, fine)) = levels.last_mut() else {
            return;
        };
        for (i, texel) in fine.iter_mut().enumerate().filter(|(_, t)| t.1 == 0.0) {
            *texel = coarse[(i / *side / 2) * half + i % *side / 2];
        }
        if levels.len() == 1 {
            for (texel, (value, _)) in texels.iter_mut().zip(&levels[0].1) {
                *texel = *value;
            }
        }
    }
}

fn neighbours(i: usize, size: usize) -> impl Iterator<Item = usize> {
    let (x, y) = ((i % size) as isize, (i / size) as isize);
    let around = (-1..=1isize).flat_map(move |dy| (-1..=1isize).map(move |dx| (x + dx, y + dy)));
    let within = move |&(u, v): &(isize, isize)| {
        (u, v) != (x, y) && (0..size as isize).contains(&u) && (0..size as isize).contains(&v)
    };
    around.filter(within).map(move |(u, v)| v as usize * size + u as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_triangle_covers_its_half_of_the_texels_once() {
        let half = Atlas { uvs: vec![[Vec2::ZERO, Vec2::X, Vec2::Y]], ..Atlas::default() };
        let map = texel_map(&half, 8);
        // 28 centres lie below the diagonal, the 8 on it belong to one side or the other as a whole.
        let covered = map.iter().flatten().count();
        assert!(covered == 28 || covered == 36, "{covered}");
        let first = map[0].expect("the corner texel");
        assert!((first.barycentric - Vec3::new(0.875, 0.0625, 0.0625)).length() < 1e-6);
    }

    #[test]
    fn dilation_moves_one_ring_a_step() {
        let mut texels = vec![Vec4::ZERO; 25];
        let mut known = vec![false; 25];
        (texels[12], known[12]) = (Vec4::ONE, true);
        dilate(&mut texels, &mut known, 5, 1);
        assert_eq!(known.iter().filter(|k| **k).count(), 9);
        dilate(&mut texels, &mut known, 5, 5);
        assert!(texels.iter().all(|t| *t == Vec4::ONE));
    }

    #[test]
    fn filling_reaches_everything_and_keeps_what_is_known() {
        let mut texels = vec![Vec4::ZERO; 64 * 64];
        let mut known = vec![false; 64 * 64];
        (texels[5 * 64 + 5], known[5 * 64 + 5]) = (Vec4::ONE, true);
        fill(&mut texels, &known, 64);
        assert!(texels.iter().all(|t| *t == Vec4::ONE));
    }
}
