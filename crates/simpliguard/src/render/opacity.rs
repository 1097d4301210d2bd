//! The opacity of a source's surfaces, by the alpha that they have where their triangles are.

use glam::Vec3;

use super::surface_sampler::{Footprint, SurfaceSampler};
use crate::data::{AlphaMode, area_vector};

/// Alpha up to which a point counts as clear, and from which on it counts as opaque.
const CLEAR: f32 = 0.1;
const OPAQUE: f32 = 0.95;
/// Bins for the alpha between.
const BINS: usize = 8;
/// Fraction of a blended surface that must be opaque, for the whole to be drawn without blending.
const NEARLY_ALL: f64 = 0.995;
/// Largest fraction of what a cut-out shows that may be neither clear nor opaque: the soft edges of leaves and hairs.
const MOST_EDGES: f64 = 0.6;
/// Largest fraction of what a cut-out shows that may have about the same alpha between. Edges have all of them alike; a pane
/// of glass has one.
const MOST_ALIKE: f64 = 0.15;
/// Approximate number of points at which the triangles of a material are sampled.
const POINTS: f64 = 8192.0;
/// Most points in one triangle.
const MOST_POINTS: f64 = 1024.0;
/// Points along a side of the grid in a triangle over which its range of alpha is taken.
const GRID: u32 = 8;

/// What the triangles of a blended material are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opacity {
    /// All of them hide what is behind.
    Opaque,
    /// Their outline is in their alpha, which is low or high nearly everywhere.
    CutOut,
    /// Something shows through.
    Clear,
}

impl Opacity {
    /// The opacity of some triangles of one material, by their area.
    pub fn of(sampler: &SurfaceSampler<'_>, triangles: &[u32]) -> Self {
        let histogram = Histogram::of(sampler, triangles);
        let shown = histogram.opaque + histogram.between.iter().sum::<f64>();
        let edges = shown - histogram.opaque;
        let alike = histogram.between.iter().fold(0.0, |a: f64, b| a.max(*b));
        if shown + histogram.clear <= 0.0 || histogram.opaque >= NEARLY_ALL * (shown + histogram.clear) {
            Self::Opaque
        } else if histogram.opaque > 0.0 && edges <= MOST_EDGES * shown && alike <= MOST_ALIKE * shown {
            Self::CutOut
        } else {
            Self::Clear
        }
    }
}

/// Areas by their alpha.
#[derive(Default)]
struct Histogram {
    clear: f64,
    between: [f64; BINS],
    opaque: f64,
}

impl Histogram {
    fn of(sampler: &SurfaceSampler<'_>, triangles: &[u32]) -> Self {
        let area = |t: u32| 0.5 * f64::from(area_vector(corners(sampler, t)).length());
        let total: f64 = triangles.iter().map(|&t| area(t)).sum();
        let mut out = Self::default();
        // One sequence over all triangles: each may have a single point, but not the same one.
        let mut next = 0u32;
        for &t in triangles {
            let area = area(t);
            let points = (POINTS * area / total.max(f64::MIN_POSITIVE)).ceil().clamp(1.0, MOST_POINTS) as u32;
            for _ in 0..points {
                next = next.wrapping_add(1);
                let alpha = sampler.color(t as usize, low_discrepancy(next), Footprint::new(0.0, 1.0)).w;
                let bin = ((alpha - CLEAR) / (OPAQUE - CLEAR) * BINS as f32) as usize;
                *match alpha {
                    alpha if alpha < CLEAR => &mut out.clear,
                    alpha if alpha < OPAQUE => &mut out.between[bin.min(BINS - 1)],
                    _ => &mut out.opaque,
                } += area / f64::from(points);
            }
        }
        out
    }
}

/// The least, the mean and the largest alpha of a triangle, over a grid of points that each stand for a part of it.
pub fn alpha_range(sampler: &SurfaceSampler<'_>, t: u32) -> [f32; 3] {
    let footprint = Footprint::new(1.0, (GRID * GRID) as f32);
    let (mut low, mut sum, mut high, mut count) = (f32::MAX, 0.0, 0.0f32, 0.0);
    for b in grid() {
        let alpha = sampler.color(t as usize, b, footprint).w;
        (low, sum, high, count) = (low.min(alpha), sum + alpha, high.max(alpha), count + 1.0);
    }
    [low, sum / count, high]
}

/// The fraction of a triangle that is not cut out, 0 to 1.
pub fn shown_fraction(sampler: &SurfaceSampler<'_>, t: u32) -> f32 {
    let AlphaMode::Mask { cutoff } = sampler.material(t as usize).alpha_mode else { return 1.0 };
    let is_shown = |b: &Vec3| sampler.color(t as usize, *b, Footprint::new(0.0, 1.0)).w >= cutoff;
    grid().filter(is_shown).count() as f32 / grid().count() as f32
}

/// Points that are spread evenly over a triangle, in barycentric coordinates.
fn grid() -> impl Iterator<Item = Vec3> {
    let point = |(i, j): (u32, u32)| {
        let [u, v] = [i, j].map(|k| (k as f32 + 1.0 / 3.0) / GRID as f32);
        Vec3::new(1.0 - u - v, u, v)
    };
    (0..GRID).flat_map(|i| (0..GRID - i).map(move |j| (i, j))).map(point)
}

fn corners(sampler: &SurfaceSampler<'_>, t: u32) -> [Vec3; 3] {
    let surface = &sampler.model().surface;
    surface.triangles[t as usize].map(|v| surface.positions[v as usize])
}

/// Point `i` of a sequence that covers a triangle evenly (R2, Roberts 2018), in barycentric coordinates.
fn low_discrepancy(i: u32) -> Vec3 {
    let along = |step: f64| ((0.5 + step * f64::from(i)).fract()) as f32;
    let (u, v) = (along(0.754_877_666_246_692_8), along(0.569_840_290_998_053_2));
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    Vec3::new(1.0 - u - v, u, v)
}

#[cfg(test)]
mod tests {
    use glam::{Affine2, Vec2};
    use image::{Rgba, RgbaImage};

    use super::*;
    use crate::data::{AlphaMode, Material, Model, Surface, Texture, TextureRef, Wrap};

    /// A square with an image of 64 x 64 texels whose alpha is given by its column.
    fn square(alpha: &dyn Fn(u32) -> u8) -> Model {
        let image = RgbaImage::from_fn(64, 64, |x, _| Rgba([255, 255, 255, alpha(x)]));
        let texture = TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY };
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let surface = Surface {
            positions: corners.map(|c| c.extend(0.0)).to_vec(),
            normals: vec![Vec3::Z; 4],
            uvs: [corners.to_vec(), Vec::new()],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material: vec![0; 2],
            ..Surface::default()
        };
        let material =
            Material { base_color_texture: Some(texture), alpha_mode: AlphaMode::Blend, ..Material::default() };
        let textures = vec![Texture::new(&image, [Wrap::Clamp; 2], true)];
        Model { surface, materials: vec![material], textures, ..Model::empty("square") }
    }

    fn opacity(alpha: impl Fn(u32) -> u8) -> Opacity {
        Opacity::of(&SurfaceSampler::new(&square(&alpha)), &[0, 1])
    }

    #[test]
    fn alpha_at_both_ends_is_a_cut_out() {
        assert_eq!(opacity(|x| if x < 40 { 0 } else { 255 }), Opacity::CutOut);
        // Soft edges, as of hair.
        assert_eq!(opacity(|x| (x.saturating_sub(20) * 12).min(255) as u8), Opacity::CutOut);
    }

    #[test]
    fn alpha_between_is_clear() {
        assert_eq!(opacity(|_| 80), Opacity::Clear);
        assert_eq!(opacity(|_| 230), Opacity::Clear);
        assert_eq!(opacity(|x| if x < 10 { 255 } else { 80 }), Opacity::Clear);
        // A shadow, which fades out.
        assert_eq!(opacity(|x| (x * 2) as u8), Opacity::Clear);
        assert_eq!(opacity(|_| 0), Opacity::Clear);
    }

    #[test]
    fn many_small_triangles_are_sampled_everywhere() {
        let mut model = square(&|x| if x % 32 < 20 { 0 } else { 255 });
        let surface = &mut model.surface;
        surface.positions = (0..100).flat_map(|_| surface.positions.clone()).collect();
        surface.triangles = (0..30_000).map(|i| [4 * (i % 100), 4 * (i % 100) + 1, 4 * (i % 100) + 2]).collect();
        surface.uvs[0] = (0..100).flat_map(|_| [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]).collect();
        surface.material = vec![0; 30_000];
        let all: Vec<u32> = (0..30_000).collect();
        assert_eq!(Opacity::of(&SurfaceSampler::new(&model), &all), Opacity::CutOut);
    }

    #[test]
    fn a_cut_out_shows_a_part_of_its_triangles() {
        let mut model = square(&|x| if x < 32 { 0 } else { 255 });
        let fractions = |model: &Model| [0, 1].map(|t| shown_fraction(&SurfaceSampler::new(model), t));
        assert_eq!(fractions(&model), [1.0; 2]);
        model.materials[0].alpha_mode = AlphaMode::Mask { cutoff: 0.5 };
        let [first, second] = fractions(&model);
        assert!((first - 0.75).abs() < 0.1 && (second - 0.25).abs() < 0.1, "{first} {second}");
    }

    #[test]
    fn full_alpha_needs_no_blending() {
        assert_eq!(opacity(|_| 255), Opacity::Opaque);
    }
}
