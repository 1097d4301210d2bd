//! Thins models whose triangles lie on each other.
//!
//! The time of nearly every stage grows with the number of triangles above each other: rays meet all of them, and views
//! draw all of them. Neither shows in a level. So stacks of coincident triangles are cut to their first ones. If the
//! others still cover the model's bounding box too many times, those that cameras see best are kept.

use rayon::slice::ParallelSliceMut as _;

use super::runner::Runner;
use crate::data::{Model, Surface, bounds};
use crate::geometry::{BoundingSphere, area_vector, fibonacci_directions};
use crate::render::{Camera, EMPTY_PIXEL, Raster, Rect};
use crate::{Cancellation, Error};

/// Most triangles of a stack. Sound models repeat a triangle a few times.
const STACK: usize = 16;
/// Corners that coincide within the longest edge divided by this are equal.
const CELLS: f64 = 1024.0;
/// Most area of all triangles, as a multiple of half the area of the bounding box. Of 64 real models the densest, a
/// tree, has 12.
const MOST_COVERAGE: f64 = 128.0;
/// Area that the triangles of a model over that limit keep, in the same unit.
const KEPT_COVERAGE: f64 = 16.0;
/// Side of the buffers that tell how well a triangle is seen, in pixels.
const SIZE: usize = 256;
/// Number of those buffers.
const DIRECTIONS: usize = 14;
/// Triangles between two looks at the cancellation.
const AT_ONCE: usize = 256;

/// Drops triangles that lie on others, with a note for the report. Changes no model within the limits.
///
/// # Errors
/// If cancelled.
pub(super) fn thin(model: &mut Model, run: &Runner<'_>) -> Result<(), Error> {
    let all = model.surface.triangles.len();
    if let Some(kept) = without_stacks(&model.surface) {
        model.surface = model.surface.subset(&kept);
        let dropped = all - kept.len();
        model
            .notes
            .push(format!("{dropped} faces that coincide with {STACK} others or more are left out of the levels"));
    }
    run.check()?;
    let coverage = Coverage::of(&model.surface);
    if coverage.ratio() > MOST_COVERAGE {
        let pixels = visible_pixels(model, run.cancellation());
        run.check()?;
        let kept = best_seen(&coverage, &pixels);
        if !kept.is_empty() {
            let dropped = model.surface.triangles.len() - kept.len();
            model.surface = model.surface.subset(&kept);
            model.notes.push(format!(
                "{dropped} faces that others hide are left out of the levels: all together they cover the bounding box \
                 {:.0} times",
                coverage.ratio()
            ));
        }
    }
    Ok(())
}

/// The triangles without those that coincide with [`STACK`] earlier ones of the same material; `None` if all stay.
fn without_stacks(surface: &Surface) -> Option<Vec<u32>> {
    let faces = surface.triangles.iter().zip(&surface.material).zip(0u32..);
    let mut keyed: Vec<(u64, u32)> = faces.map(|((t, &material), i)| (stack_key(surface, t, material), i)).collect();
    keyed.par_sort_unstable();
    let mut kept = Vec::with_capacity(keyed.len());
    for stack in keyed.chunk_by(|a, b| a.0 == b.0) {
        kept.extend(stack.iter().take(STACK).map(|(_, t)| *t));
    }
    if kept.len() == keyed.len() {
        return None;
    }
    kept.sort_unstable();
    Some(kept)
}

/// A key that is equal for triangles of one material whose corners coincide.
fn stack_key(surface: &Surface, triangle: &[u32; 3], material: u32) -> u64 {
    let corners = triangle.map(|v| surface.positions[v as usize]);
    let edges = [0, 1, 2].map(|k| corners[k].distance_squared(corners[(k + 1) % 3]));
    // The size of a cell is a power of two, the same for edges of about the same length.
    let longest = f64::from(edges[0].max(edges[1]).max(edges[2])).max(f64::MIN_POSITIVE);
    let octave = libm::ilogb(longest).div_euclid(2);
    let scale = CELLS * libm::exp2(-f64::from(octave));
    let cells = corners.map(|p| p.to_array().map(|x| libm::floor(f64::from(x) * scale).to_bits()));
    let first = (0..3).min_by_key(|&k| cells[k]).unwrap_or(0);
    let start = mixed(u64::from(material), octave as u64);
    (0..3).flat_map(|k| cells[(first + k) % 3]).fold(start, mixed)
}

/// A hash of a hash and a further value (the finaliser of SplitMix64).
fn mixed(hash: u64, value: u64) -> u64 {
    let z = (hash ^ value).wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The area of the triangles of a surface, and that of its bounding box.
struct Coverage {
    /// Area of each triangle.
    areas: Vec<f64>,
    /// Half the area of the bounding box.
    bounding_box: f64,
}

impl Coverage {
    fn of(surface: &Surface) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| surface.positions[v as usize].as_dvec3());
        let areas = surface.triangles.iter().map(|t| 0.5 * area_vector(&corners(t)).length()).collect();
        let (low, high) = bounds(&surface.positions);
        let side = (high - low).as_dvec3();
        Self { areas, bounding_box: side.x * side.y + side.y * side.z + side.z * side.x }
    }

    /// Number of times that the triangles would cover the bounding box; zero for a box without an area.
    fn ratio(&self) -> f64 {
        if self.bounding_box > 0.0 { self.areas.iter().sum::<f64>() / self.bounding_box } else { 0.0 }
    }
}

/// The triangles with the most visible pixels for their area, ascending, as many as [`KEPT_COVERAGE`] admits.
fn best_seen(coverage: &Coverage, pixels: &[u32]) -> Vec<u32> {
    let density = |t: u32| f64::from(pixels[t as usize]) / coverage.areas[t as usize].max(f64::MIN_POSITIVE);
    let mut order: Vec<u32> = (0..pixels.len() as u32).filter(|&t| pixels[t as usize] > 0).collect();
    order.sort_unstable_by(|&a, &b| density(b).total_cmp(&density(a)).then(a.cmp(&b)));
    let mut left = KEPT_COVERAGE * coverage.bounding_box;
    let fits = |t: &u32| {
        left -= coverage.areas[*t as usize];
        left >= 0.0
    };
    let mut kept: Vec<u32> = order.into_iter().take_while(fits).collect();
    kept.sort_unstable();
    kept
}

/// Number of pixels that show each triangle, over all buffers. Unfinished if cancelled.
fn visible_pixels(model: &Model, cancellation: &Cancellation) -> Vec<u32> {
    let surface = &model.surface;
    let sphere = BoundingSphere::around(&surface.positions);
    let mut pixels = vec![0; surface.triangles.len()];
    let mut raster = Raster::new(SIZE);
    for direction in fibonacci_directions(DIRECTIONS) {
        raster.clear(Rect { x0: 0, y0: 0, x1: SIZE, y1: SIZE });
        let corners = raster.pixel_corners(&Camera::orbit(&sphere, direction, 0.6, 1.0).project(&surface.positions));
        for (t, triangle) in surface.triangles.iter().enumerate() {
            if t % AT_ONCE == 0 && cancellation.is_cancelled() {
                return pixels;
            }
            let double_sided = model.material_of(t as u32).double_sided;
            raster.draw_tested(t, triangle.map(|v| corners[v as usize]), double_sided, |_, _, _| true);
        }
        raster.ids.iter().filter(|&&id| id != EMPTY_PIXEL).for_each(|&id| pixels[id as usize] += 1);
    }
    pixels
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::Context;
    use crate::data::Material;

    /// Triangles of one size at these heights, of one material.
    fn stack(heights: impl Iterator<Item = f32>) -> Model {
        let mut surface = Surface::default();
        for (t, z) in heights.enumerate() {
            surface.positions.extend([Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * z));
            surface.triangles.push([0, 1, 2].map(|k| 3 * t as u32 + k));
        }
        surface.normals = vec![Vec3::Z; surface.positions.len()];
        surface.uvs[0] = vec![glam::Vec2::ZERO; surface.positions.len()];
        surface.material = vec![0; surface.triangles.len()];
        let material = Material { double_sided: true, ..Material::default() };
        Model { surface, materials: vec![material], ..Model::empty("stack") }
    }

    fn thinned(mut model: Model) -> Model {
        let context = Context::default();
        thin(&mut model, &Runner::new("stack", &context)).expect("not cancelled");
        model
    }

    #[test]
    fn a_sound_model_stays_as_it_is() {
        let model = stack((0..100).map(|i| i as f32 * 0.1));
        let surface = model.surface.clone();
        let out = thinned(model);
        assert!(out.surface == surface && out.notes.is_empty());
    }

    #[test]
    fn a_stack_keeps_its_first_faces() {
        let mut model = stack((0..1000).map(|i| i as f32 * 1e-8).chain([1.0]));
        // A corner as the first one makes no other triangle; another direction does.
        model.surface.triangles[1] = [4, 5, 3];
        model.surface.triangles[2] = [6, 8, 7];
        let out = thinned(model);
        assert_eq!(out.surface.triangles.len(), STACK + 2);
        assert_eq!(out.notes, ["983 faces that coincide with 16 others or more are left out of the levels"]);
    }

    #[test]
    fn of_a_heap_the_faces_that_are_seen_stay() {
        let out = thinned(stack((0..2000).map(|i| i as f32 * 0.0015)));
        let coverage = Coverage::of(&out.surface).ratio();
        assert!(out.notes[0].contains(" faces that others hide ") && coverage <= KEPT_COVERAGE, "{:?}", out.notes);
        let heights = out.surface.positions.iter().map(|p| p.z);
        assert_eq!(heights.clone().fold(f32::MAX, f32::min), 0.0);
        assert_eq!(heights.fold(0.0, f32::max), 1999.0 * 0.0015);
    }

    #[test]
    fn a_cancelled_bake_ends() {
        let context = Context::default();
        context.cancellation.cancel();
        let mut model = stack((0..2000).map(|i| i as f32 * 0.0015));
        assert!(matches!(thin(&mut model, &Runner::new("stack", &context)), Err(Error::Cancelled { .. })));
    }
}
