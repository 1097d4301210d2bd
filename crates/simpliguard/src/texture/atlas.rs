//! Which point of the mesh each texel stands for.

use glam::{Vec2, Vec3, Vec4};

use crate::render::raster::scan;
use crate::unwrap::Atlas;

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
}
