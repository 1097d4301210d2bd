//! The solution at half the size, which the one at full size starts from and trusts pixels by.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use crate::refine::lookup::Lookup;

/// A solution of half the side.
#[derive(Clone, Debug)]
pub struct CoarseSolution {
    /// Side in texels.
    pub size: usize,
    /// sRGB-encoded colours.
    pub texels: Vec<Vec4>,
    /// Change from the initial texture.
    pub change: Vec<Vec4>,
    /// Error of a pixel's colour, 0 to 1, at which the pixel counts half.
    pub scale: f32,
}

impl CoarseSolution {
    /// The texels that an `initial` texture was solved to.
    pub(in crate::refine) fn new(texels: Vec<Vec4>, initial: &[Vec4], size: usize, scale: f32) -> Self {
        let change = texels.iter().zip(initial).map(|(after, before)| *after - *before).collect();
        Self { size, texels, change, scale }
    }

    /// Adds the same change to a texture of twice the side.
    pub(super) fn add_change(&self, texels: &mut [Vec4], size: usize) {
        texels.par_chunks_mut(size).enumerate().for_each(|(y, row)| {
            for (x, texel) in row.iter_mut().enumerate() {
                let uv = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * 0.5;
                *texel += Lookup::new(uv, self.size).sample(&self.change, self.size);
            }
        });
    }

    /// Weight of a pixel of this colour, 0 to 1. `uv` are its texture coordinates at full size, in texels.
    pub(super) fn trust(&self, uv: Vec2, color: Vec3) -> f32 {
        let solved = Lookup::new(uv * 0.5, self.size).sample(&self.texels, self.size).xyz();
        1.0 / (1.0 + (solved - color).length_squared() / (self.scale * self.scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refine::texture_least_squares::normal_equations::NormalEquations;

    #[test]
    fn a_pixel_counts_by_how_well_it_agrees() {
        let coarse = CoarseSolution { texels: vec![Vec4::splat(0.5); 4], change: Vec::new(), size: 2, scale: 0.3 };
        let weight = |error: f32| coarse.trust(Vec2::splat(1.0), Vec3::new(0.5 + error, 0.5, 0.5));
        assert!(weight(0.0) > 0.999 && (weight(0.3) - 0.5).abs() < 1e-5 && weight(-0.5) < 0.3);
        let lookup = Lookup::new(Vec2::splat(0.5), 2);
        let mut equations = NormalEquations::new(2);
        for (color, weight) in [(1.0, 0.25), (0.2, 0.75)] {
            equations.add_pixel(lookup, Vec3::splat(color), weight);
        }
        let rows = &equations.rows;
        assert!((rows[0].b.x / rows[0].a.x - 0.4).abs() < 1e-6);
    }

    #[test]
    fn a_texture_of_twice_the_side_changes_alike() {
        let change = (0..16).map(|i| Vec4::splat((i % 4) as f32)).collect();
        let coarse = CoarseSolution { texels: Vec::new(), change, size: 4, scale: 0.3 };
        let mut texels = vec![Vec4::splat(10.0); 64];
        coarse.add_change(&mut texels, 8);
        let row: Vec<f32> = texels[24..32].iter().map(|t| t.x - 10.0).collect();
        // Texel centres lie a quarter of the larger texels on either side of theirs.
        assert_eq!(row[1..7], [0.25, 0.75, 1.25, 1.75, 2.25, 2.75]);
    }
}
