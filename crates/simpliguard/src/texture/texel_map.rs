//! The point of the mesh that each texel stands for.

use std::ops::{Add, Mul};

use glam::{Vec2, Vec3};

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

impl Texel {
    /// The value at the texel's centre, interpolated from the values at the vertices.
    #[inline]
    pub(super) fn interpolate<T>(&self, triangles: &[[u32; 3]], values: &[T]) -> T
    where
        T: Copy + Add<Output = T> + Mul<f32, Output = T>,
    {
        let [u, v, w] = triangles[self.triangle as usize].map(|v| values[v as usize]);
        let b = self.barycentric;
        u * b.x + v * b.y + w * b.z
    }
}

/// The triangle under the centre of each texel.
#[derive(Clone, Debug, PartialEq)]
pub struct TexelMap {
    /// Side of the texture, in texels.
    pub size: usize,
    /// Rows from the top; `None` where no triangle covers the centre.
    pub texels: Vec<Option<Texel>>,
}

impl TexelMap {
    /// Rasterises the atlas into a texture of `size` x `size` texels.
    pub fn new(atlas: &Atlas, size: usize) -> Self {
        let mut texels = vec![None; size * size];
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
                    texels[y * size + x] = Some(Texel { triangle: t as u32, barycentric });
                }
            });
        }
        Self { size, texels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_triangle_covers_its_half_of_the_texels_once() {
        let half = Atlas { uvs: vec![[Vec2::ZERO, Vec2::X, Vec2::Y]], ..Atlas::default() };
        let map = TexelMap::new(&half, 8).texels;
        // 28 centres lie below the diagonal, the 8 on it belong to one side or the other as a whole.
        let covered = map.iter().flatten().count();
        assert!(covered == 28 || covered == 36, "{covered}");
        let first = map[0].expect("the corner texel");
        assert!((first.barycentric - Vec3::new(0.875, 0.0625, 0.0625)).length() < 1e-6);
    }
}
