//! Visibility of faces from outside: identity buffers from many directions tell which faces are seen, and how many pixels
//! they cover.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::{BoundingSphere, fibonacci_directions};
use crate::render::{Camera, EMPTY_PIXEL, Raster, Rect};

/// Number of directions from which a mesh is viewed in the rest pose.
pub(super) const DIRECTIONS: usize = 48;
/// Least number of directions of one task: each has buffers of its own.
pub(super) const MIN_DIRECTIONS: usize = 6;
/// Side of the identity buffer in pixels.
pub(super) const SIZE: usize = 640;
/// What a pixel beside the background counts in addition. A surface that is a little off shows it along outlines, where it
/// covers wrong pixels; elsewhere only its texture shifts. Four fifths of the squared error of levels of sound models lies
/// within a pixel of an outline. Between 40 and 400, levels hardly differ.
pub(super) const OUTLINE_WEIGHT: u32 = 100;
/// The same beside another surface, whose colour is often more alike.
const INNER_OUTLINE_WEIGHT: u32 = 50;
/// Least difference in depth at an outline. The depth of a model extends over about two.
const OUTLINE_DEPTH: f32 = 0.04;
/// What views show of each face, summed over the views.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FacePixels {
    /// Number of pixels.
    pub(super) covered: Vec<u32>,
    /// What the pixels on outlines count in addition.
    pub(super) outlines: Vec<u32>,
}

impl FacePixels {
    pub(super) fn none(faces: usize) -> Self {
        Self { covered: vec![0; faces], outlines: vec![0; faces] }
    }

    /// The number of pixels of each face, where those on outlines count many times.
    pub(super) fn weighted(&self) -> Vec<u32> {
        self.covered.iter().zip(&self.outlines).map(|(covered, outlines)| covered + outlines).collect()
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.covered.iter_mut().zip(&other.covered).for_each(|(sum, n)| *sum += n);
        self.outlines.iter_mut().zip(&other.outlines).for_each(|(sum, n)| *sum += n);
    }

    /// Adds the pixels of one view. `rect` holds the model with a margin of one pixel.
    fn add_view(&mut self, raster: &Raster, rect: Rect) {
        for y in rect.rows() {
            for i in y * SIZE + rect.x0..y * SIZE + rect.x1.max(rect.x0) {
                let id = raster.ids[i];
                if id != EMPTY_PIXEL {
                    self.covered[id as usize] += 1;
                    self.outlines[id as usize] += outline_weight(raster, i);
                }
            }
        }
    }
}

/// The pixels beside a pixel; some may lie outside of the buffer.
pub(super) fn neighbours(pixel: usize) -> [usize; 4] {
    [pixel.wrapping_sub(1), pixel + 1, pixel.wrapping_sub(SIZE), pixel + SIZE]
}

/// What a covered pixel counts more than others because it lies on an outline.
fn outline_weight(raster: &Raster, pixel: usize) -> u32 {
    let depths = neighbours(pixel).into_iter().filter_map(|i| raster.depth.get(i));
    let farthest = depths.fold(f32::MIN, |farthest, depth| depth.max(farthest));
    match farthest {
        f32::MAX => OUTLINE_WEIGHT,
        farthest if farthest > raster.depth[pixel] + OUTLINE_DEPTH => INNER_OUTLINE_WEIGHT,
        _ => 0,
    }
}

/// The pixels of each face in views from `directions`. Back faces count where `double_sided(t)`.
pub(super) fn visible_pixels(
    mesh: &TriMesh,
    sphere: &BoundingSphere,
    directions: usize,
    double_sided: &(impl Fn(usize) -> bool + Sync),
    cancellation: &Cancellation,
) -> FacePixels {
    // Not the lattice of the views, so that both do not share their blind spots.
    let turn = glam::Quat::from_xyzw(0.18, 0.37, 0.26, 0.87).normalize();
    let directions = fibonacci_directions(directions);
    let count = |(mut raster, mut clip, mut pixels): (Raster, Vec<Vec4>, FacePixels), direction: &Vec3| {
        let camera = Camera::orbit(sphere, (turn * *direction).normalize(), 0.6, 1.0);
        camera.project_into(&mesh.positions, &mut clip);
        let rect = Rect::around(&clip, SIZE, 1);
        raster.clear(rect);
        raster.draw(&clip, &mesh.triangles, double_sided);
        pixels.add_view(&raster, rect);
        (raster, clip, pixels)
    };
    let empty = || FacePixels::none(mesh.triangles.len());
    let wanted = directions.par_iter().with_min_len(MIN_DIRECTIONS).take_any_while(|_| !cancellation.is_cancelled());
    let counts = wanted.fold(|| (Raster::new(SIZE), Vec::new(), empty()), count).map(|(.., pixels)| pixels);
    counts.reduce(empty, |mut a, b| {
        a.add(&b);
        a
    })
}

/// Faces of two sides show more pixels than the others. `pixels` has the number of each face.
pub(super) fn most_are_double_sided(pixels: &[u32], is_double_sided: impl Fn(usize) -> bool) -> bool {
    let (mut double, mut all) = (0, 0);
    for (t, &n) in pixels.iter().enumerate() {
        all += u64::from(n);
        double += if is_double_sided(t) { u64::from(n) } else { 0 };
    }
    2 * double > all
}

/// Adds the faces that share a vertex with a set of faces to the set, `rings` times.
pub(super) fn grow(mesh: &TriMesh, faces: &mut [bool], rings: usize) {
    for _ in 0..rings {
        let mut touched = vec![false; mesh.positions.len()];
        for (triangle, _) in mesh.triangles.iter().zip(&*faces).filter(|(_, seen)| **seen) {
            triangle.iter().for_each(|&v| touched[v as usize] = true);
        }
        for (triangle, face) in mesh.triangles.iter().zip(&mut *faces) {
            *face |= triangle.iter().any(|&v| touched[v as usize]);
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A unit tetrahedron inside one five times as large.
    pub(crate) fn nested() -> TriMesh {
        let corners = [[-1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]].map(Vec3::from);
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        TriMesh {
            positions: corners.iter().copied().chain(corners.iter().map(|c| *c * 5.0)).collect(),
            triangles: faces.iter().copied().chain(faces.map(|f| f.map(|v| v + 4))).collect(),
        }
    }

    #[test]
    fn cameras_see_the_outer_shell_alone() {
        let mesh = nested();
        let pixels =
            visible_pixels(&mesh, &BoundingSphere::around(&mesh.positions), 72, &|_| false, &Cancellation::default());
        let covered = &pixels.covered;
        assert!(covered[..4].iter().all(|&n| n == 0) && covered[4..].iter().all(|&n| n > 0), "{covered:?}");
        let weighted = pixels.weighted();
        assert!(weighted[..4].iter().all(|&n| n == 0) && (4..8).all(|t| weighted[t] > covered[t]), "{weighted:?}");
    }

    #[test]
    fn outlines_count_more_before_the_background_than_before_another_surface() {
        let mut raster = Raster::new(SIZE);
        let row = 10 * SIZE;
        // A near surface of three pixels, and a far one to its right; nothing else.
        for (x, depth) in [(5, -0.5), (6, -0.5), (7, -0.5), (8, 0.5), (9, 0.5)] {
            for y in [row - SIZE, row, row + SIZE] {
                (raster.ids[y + x], raster.depth[y + x]) = (u32::from(depth > 0.0), depth);
            }
        }
        let weights = [5, 6, 7, 8, 9].map(|x| outline_weight(&raster, row + x));
        assert_eq!(weights, [OUTLINE_WEIGHT, 0, INNER_OUTLINE_WEIGHT, 0, OUTLINE_WEIGHT]);
        let mut pixels = FacePixels::none(2);
        pixels.add_view(&raster, Rect { x0: 4, y0: 10, x1: 11, y1: 11 });
        assert_eq!(pixels.covered, [3, 2]);
        assert_eq!(pixels.weighted(), [3 + OUTLINE_WEIGHT + INNER_OUTLINE_WEIGHT, 2 + OUTLINE_WEIGHT]);
    }

    #[test]
    fn rings_grow_over_shared_vertices() {
        let mesh = nested();
        let mut seen = [false, false, false, false, true, false, false, false];
        grow(&mesh, &mut seen, 1);
        assert_eq!(seen, [false, false, false, false, true, true, true, true]);
    }
}
