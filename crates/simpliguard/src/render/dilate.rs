//! Colours for texels that no face covers.

use glam::Vec4;

use crate::data::image::halved;

/// Rings of texels around each chart that dilation fills. Coarser scales fill the rest.
const GUTTER_RINGS: usize = 8;

/// Gives unknown texels the mean of their known neighbours, ring by ring, for at most `rings` rings, and marks them as
/// known.
pub fn dilate(texels: &mut [Vec4], known: &mut [bool], size: usize, rings: usize) {
    let touches = |i: usize| neighbours(i, size).any(|j| known[j]);
    let mut ring: Vec<usize> = (0..texels.len()).filter(|&i| !known[i] && touches(i)).collect();
    let mut is_listed = known.to_vec();
    for _ in 0..rings {
        let means: Vec<Vec4> = ring.iter().map(|&i| mean_around(texels, known, i, size)).collect();
        for (&i, mean) in ring.iter().zip(means) {
            (texels[i], known[i], is_listed[i]) = (mean, true, true);
        }
        let around = ring.iter().flat_map(|&i| neighbours(i, size));
        ring = around.filter(|&j| !std::mem::replace(&mut is_listed[j], true)).collect();
    }
}

/// The mean of the known texels around a texel that has any.
fn mean_around(texels: &[Vec4], known: &[bool], i: usize, size: usize) -> Vec4 {
    let around = neighbours(i, size).filter(|&j| known[j]);
    let (sum, count) = around.fold((Vec4::ZERO, 0.0), |(sum, count), j| (sum + texels[j], count + 1.0));
    sum / count
}

/// Gives every unknown texel of a `size` x `size` texture a value, so that no mip level mixes in a foreign colour.
///
/// [`dilate`] fills the rings around the charts. Texels farther away take the mean of the known texels around them from
/// the finest scale at which there are any (pull-push, Gortler et al. 1996).
pub fn fill_unknown(texels: &mut [Vec4], known: &[bool], size: usize) {
    let mut known = known.to_vec();
    dilate(texels, &mut known, size, GUTTER_RINGS);
    let weighted = texels.iter().zip(&known).map(|(t, k)| if *k { (*t, 1.0) } else { (Vec4::ZERO, 0.0) }).collect();
    let mut pyramid = vec![Scale { size, texels: weighted }];
    while let Some(fine) = pyramid.last().filter(|scale| scale.size > 1) {
        pyramid.push(fine.halved());
    }
    while let Some(coarse) = pyramid.pop() {
        let Some(fine) = pyramid.last_mut() else { return };
        fine.fill_from(&coarse);
        if pyramid.len() == 1 {
            texels.iter_mut().zip(&pyramid[0].texels).for_each(|(texel, (value, _))| *texel = *value);
        }
    }
}

/// A texture at one scale.
struct Scale {
    /// Side in texels.
    size: usize,
    /// Value of each texel and its weight: one if it is known, else zero.
    texels: Vec<(Vec4, f32)>,
}

impl Scale {
    /// The texture at half the size. A texel is the mean of the known ones of its four, and known if there are any.
    fn halved(&self) -> Self {
        let mean = |four: [(Vec4, f32); 4]| {
            let weight: f32 = four.iter().map(|f| f.1).sum();
            let sum: Vec4 = four.iter().map(|f| f.0 * f.1).sum();
            if weight > 0.0 { (sum / weight, 1.0) } else { (Vec4::ZERO, 0.0) }
        };
        Self { size: self.size / 2, texels: halved(&self.texels, [self.size; 2], mean) }
    }

    /// Gives unknown texels the value of the texel at half the size that covers them.
    fn fill_from(&mut self, coarse: &Self) {
        let size = self.size;
        for (i, texel) in self.texels.iter_mut().enumerate().filter(|(_, t)| t.1 == 0.0) {
            *texel = coarse.texels[(i / size / 2) * coarse.size + i % size / 2];
        }
    }
}

/// The texels around a texel: eight, or fewer at the border.
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
        fill_unknown(&mut texels, &known, 64);
        assert!(texels.iter().all(|t| *t == Vec4::ONE));
    }
}
