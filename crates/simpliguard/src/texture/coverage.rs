//! Keeps a crown as dense as its source. Leaves lie on their card at an angle and overlap, so that the card shows a smaller
//! area of them than there is.

use glam::Vec3;
use rayon::prelude::*;

use super::texel_map::TexelMap;
use crate::data::{Cards, NO_CARD, TriMesh, area_vector};
use crate::render::{SurfaceSample, SurfaceSampler, shown_fraction};

/// Most rings of texels that leaves grow by.
const RINGS: usize = 3;
/// Alpha from which on a texel counts as leaf.
const OPAQUE: f32 = 0.5;

/// Grows the leaves of each card of `level`, ring by ring, while their area stays below that of the leaves of the source,
/// without what is cut out of these.
pub(super) fn keep_coverage(
    samples: &mut [Option<SurfaceSample>],
    map: &TexelMap,
    source: &SurfaceSampler<'_>,
    level: &TriMesh,
    cards: &Cards,
) {
    let TexelMap { size, texels } = map;
    let card = |i: usize| texels[i].map_or(NO_CARD, |t| cards.group[t.triangle as usize]);
    let card_texels = (0..texels.len()).filter(|&i| card(i) != NO_CARD).count();
    let leaf_area = leaf_area(source, cards);
    let card_faces = (0..level.triangles.len()).filter(|&t| cards.group[t] != NO_CARD);
    let card_area = card_faces.map(|t| area(level.corners(t))).sum::<f64>().max(f64::MIN_POSITIVE);
    let desired = leaf_area / card_area * card_texels as f64;
    for _ in 0..RINGS {
        let is_leaf = |i: usize| samples[i].is_some_and(|s| s.color.w >= OPAQUE);
        let leaves = (0..texels.len()).filter(|&i| card(i) != NO_CARD && is_leaf(i)).count();
        let ring: Vec<(usize, usize)> = (0..texels.len())
            .filter(|&i| card(i) != NO_CARD && !is_leaf(i))
            .filter_map(|i| {
                let beside = [i.checked_sub(1), Some(i + 1), i.checked_sub(*size), Some(i + size)];
                let leaf = beside.into_iter().flatten().find(|&j| j < texels.len() && card(j) == card(i) && is_leaf(j));
                Some((i, leaf?))
            })
            .collect();
        // The ring that comes nearest to the desired area is the last.
        if leaves as f64 + 0.5 * ring.len() as f64 > desired {
            return;
        }
        for (i, leaf) in ring {
            samples[i] = samples[leaf];
        }
    }
}

/// Area that the leaves of the source show.
fn leaf_area(source: &SurfaceSampler<'_>, cards: &Cards) -> f64 {
    let surface = &source.model().surface;
    let corners = |t: usize| surface.triangles[t].map(|v| surface.positions[v as usize]);
    let leaves: Vec<usize> = (0..surface.triangles.len()).filter(|&t| cards.source_group[t] != NO_CARD).collect();
    let shown = |&t: &usize| area(corners(t)) * f64::from(shown_fraction(source, t as u32));
    leaves.par_iter().map(shown).collect::<Vec<f64>>().iter().sum()
}

fn area(corners: [Vec3; 3]) -> f64 {
    0.5 * f64::from(area_vector(corners).length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Material, Model, Surface};
    use crate::texture::Texel;
    use glam::Vec4;

    #[test]
    fn a_leaf_grows_to_the_area_of_its_source() {
        let square = |side: f32| TriMesh {
            positions: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
                .map(|[x, y]| Vec3::new(x, y, 0.0) * side)
                .to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let texels = vec![Some(Texel { triangle: 0, barycentric: Vec3::ZERO }); 81];
        let map = TexelMap { size: 9, texels };
        let sample = |alpha| SurfaceSample {
            color: Vec4::new(1.0, 0.0, 0.0, alpha),
            glows: false,
            normal: Vec3::Z,
            is_inverted: false,
            occlusion: 1.0,
            roughness: 1.0,
            metallic: 0.0,
            emissive: Vec3::ZERO,
        };
        let cards = Cards { group: vec![0; 2], source_group: vec![0; 2], reach: vec![0.1] };
        for (part, expected) in [(1.0f32, 1), (5.0, 5), (13.0, 13)] {
            let mut samples = vec![Some(sample(0.0)); 81];
            samples[40] = Some(sample(1.0));
            let TriMesh { positions, triangles } = square((part / 81.0).sqrt());
            let surface = Surface { positions, triangles, material: vec![0; 2], ..Surface::default() };
            let source = Model { surface, materials: vec![Material::default()], ..Model::empty("leaf") };
            keep_coverage(&mut samples, &map, &SurfaceSampler::new(&source), &square(1.0), &cards);
            let leaves = samples.iter().flatten().filter(|s| s.color.w > 0.5).count();
            assert_eq!(leaves, expected);
        }
    }
}
