//! What views show of clear surfaces in front of solid ones, and the share of a budget that this is worth.

use rayon::prelude::*;

use super::opaque::OpaqueSurface;
use super::visibility::{self, DIRECTIONS, FacePixels, MIN_DIRECTIONS, OUTLINE_WEIGHT, SIZE};
use crate::Cancellation;
use crate::data::{Model, TriMesh};
use crate::geometry::{BoundingSphere, fibonacci_directions};
use crate::render::{Camera, EMPTY_PIXEL, Raster, Rect};

/// Faces of a clear surface for one face of a solid one that shows as many pixels: in front of a solid one, less of its shape
/// is seen.
const WORTH: f64 = 0.2;
/// The same where nothing solid is behind it: there its outline is that of the model.
const OPEN_WORTH: f64 = 0.4;
/// Fewest faces of a clear surface, as a fraction of the budget: the windows of a small car on a large ground are still
/// windows.
const FEWEST: f64 = 0.02;
/// The same in faces, unless that is more than half of the budget.
const FEWEST_FACES: u32 = 8;
/// Largest fraction of a budget for all clear surfaces together, where there is a solid one.
const MOST: f64 = 0.5;
/// A mesh, and which of its faces are seen from behind.
type Sided<'a> = (&'a TriMesh, &'a (dyn Fn(usize) -> bool + Sync));

/// The number of pixels that clear and solid surfaces show, over all views.
#[derive(Clone, Debug)]
pub struct ClearPixels {
    /// Of each face of the clear surface, in front of the solid one. Outlines are those of everything together.
    pub(super) faces: FacePixels,
    /// Those of them that have nothing solid behind.
    open: u64,
    /// Of the solid surface, as if nothing clear were before it.
    solid: u64,
}

impl ClearPixels {
    fn none(faces: usize) -> Self {
        Self { faces: FacePixels::none(faces), open: 0, solid: 0 }
    }

    /// Counts the pixels of `clear`, a model of clear surfaces, in front of the solid surface of a model, if there is
    /// one.
    pub fn count(
        clear: &Model,
        solid: Option<(&Model, &OpaqueSurface)>,
        sphere: &BoundingSphere,
        cancellation: &Cancellation,
    ) -> Self {
        let clear_mesh =
            TriMesh { positions: clear.surface.positions.clone(), triangles: clear.surface.triangles.clone() };
        let is_double_sided = |t: usize| clear.material_of(t as u32).double_sided;
        let nothing = TriMesh::default();
        let solid_mesh = solid.map_or(&nothing, |(_, solid)| &solid.mesh);
        let is_solid_double_sided =
            |t: usize| solid.is_some_and(|(model, solid)| model.material_of(solid.source[t]).double_sided);
        let (clear, solid): (Sided<'_>, Sided<'_>) =
            ((&clear_mesh, &is_double_sided), (solid_mesh, &is_solid_double_sided));
        let count = |(mut raster, mut pixels): (Raster, Self), direction: &glam::Vec3| {
            pixels.add_view(clear, solid, (&Camera::orbit(sphere, *direction, 0.6, 1.0), &mut raster));
            (raster, pixels)
        };
        let none = || Self::none(clear.0.triangles.len());
        let directions = fibonacci_directions(DIRECTIONS);
        let wanted =
            directions.par_iter().with_min_len(MIN_DIRECTIONS).take_any_while(|_| !cancellation.is_cancelled());
        let counts = wanted.fold(|| (Raster::new(SIZE), none()), count).map(|(_, pixels)| pixels);
        counts.reduce(none, |a, b| a.add(&b))
    }

    fn add(mut self, other: &Self) -> Self {
        self.faces.add(&other.faces);
        Self { open: self.open + other.open, solid: self.solid + other.solid, ..self }
    }

    /// Adds the pixels of one view. Faces of `clear` do not hide each other.
    fn add_view(
        &mut self,
        (clear, clear_double_sided): Sided<'_>,
        (solid, solid_double_sided): Sided<'_>,
        (camera, raster): (&Camera, &mut Raster),
    ) {
        let (clip, clear_clip) = (camera.project(&solid.positions), camera.project(&clear.positions));
        raster.clear(Rect { x0: 0, y0: 0, x1: SIZE, y1: SIZE });
        raster.draw(&clip, &solid.triangles, solid_double_sided);
        let is_open: Vec<bool> = raster.ids.iter().map(|&id| id == EMPTY_PIXEL).collect();
        self.solid += is_open.iter().filter(|&&open| !open).count() as u64;
        let corners = raster.pixel_corners(&clear_clip);
        let mut visit_all = |visit: &mut dyn FnMut(usize, usize)| {
            for (t, triangle) in clear.triangles.iter().enumerate() {
                let triangle = triangle.map(|v| corners[v as usize]);
                raster.draw_tested(t, triangle, clear_double_sided(t), |i, _, _| {
                    visit(t, i);
                    false
                });
            }
        };
        let mut is_empty = is_open.clone();
        visit_all(&mut |_, i| is_empty[i] = false);
        let is_outline =
            |i: usize| visibility::neighbours(i).into_iter().any(|n| is_empty.get(n).is_some_and(|empty| *empty));
        visit_all(&mut |t, i| {
            self.faces.covered[t] += 1;
            self.faces.outlines[t] += if is_outline(i) { OUTLINE_WEIGHT } else { 0 };
            self.open += u64::from(is_open[i]);
        });
    }

    /// The faces out of `budget` that the clear surface is worth.
    pub fn share(&self, budget: u32) -> u32 {
        let clear: f64 = self.faces.covered.iter().map(|&n| f64::from(n)).sum();
        let (open, solid) = (self.open as f64, self.solid as f64);
        let worth = (WORTH * (clear - open) + OPEN_WORTH * open) / (clear + solid).max(1.0);
        let faces = (f64::from(budget) * worth.clamp(FEWEST, MOST)).round() as u32;
        faces.max(FEWEST_FACES.min(budget / 2)).min(self.faces.covered.len() as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_follows_the_pixels_within_its_bounds() {
        let pixels = |clear: u32, solid| ClearPixels {
            faces: FacePixels { covered: vec![clear; 1000], outlines: vec![0; 1000] },
            open: 0,
            solid,
        };
        assert_eq!(pixels(1, 3000).share(1000), 50);
        assert_eq!(ClearPixels { open: 500, ..pixels(1, 3000) }.share(1000), 75);
        assert_eq!(pixels(1, 1_000_000).share(1000), 20);
        assert_eq!(pixels(1, 1_000_000).share(200), FEWEST_FACES);
        assert_eq!(pixels(1, 0).share(4000), 800);
        assert_eq!(pixels(1, 1_000_000).share(10), 5);
    }
}
