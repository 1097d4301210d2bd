//! Scores a low-poly mesh by rendering, before it has texture coordinates.
//!
//! Each face is divided into cells, as many as its part of the surface deserves. The best colour of a cell is the mean of
//! what the source shows there, over all views; what is left after painting every cell so, together with the pixels the
//! silhouettes disagree on, is the error that no texture of that resolution removes.

use glam::{Vec4, Vec4Swizzles};
use rayon::prelude::*;

use super::inputs::Inputs;
use super::self_intersection;
use super::shape::Shape;
use crate::animation::Motions;
use crate::data::TriMesh;
use crate::render::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc};
use crate::render::{EMPTY_PIXEL, Raster, View};

/// One view in this many scores shapes.
const VIEW_STRIDE: usize = 3;
/// Approximate number of cells over the whole mesh.
const CELLS: f32 = 65_536.0;
/// Most cells along the side of a face.
const MOST_ALONG: u32 = 256;
/// Weight of the squared coverage error against those of the three colours.
const COVERAGE_WEIGHT: f32 = 1.5;

/// Scores shapes by a third of the views.
pub(super) struct Scorer<'a> {
    views: Vec<&'a View>,
    /// A factor for each pixel of each view; empty if all count alike.
    weights: Vec<Vec<f32>>,
}

impl<'a> Scorer<'a> {
    pub(super) fn new(inputs: &Inputs<'a>) -> Self {
        let views: Vec<&View> = inputs.views.iter().step_by(VIEW_STRIDE).collect();
        let weights = inputs.importance.map(|i| i.of_pixels(inputs.model, inputs.poses, &views)).unwrap_or_default();
        Self { views, weights }
    }

    /// Sets the render error, the deviation and the number of self-intersecting faces of a shape.
    pub(super) fn score(&self, inputs: &Inputs<'_>, shape: &mut Shape) {
        let motions = inputs.motions(&shape.mesh);
        shape.render_error = self.render_error(&Painter::new(&shape.mesh, &motions, shape.double_sided));
        shape.deviation = inputs.deviation_metric.measure(&shape.mesh);
        shape.self_intersecting = self_intersection::count(&shape.mesh);
    }

    /// Mean squared error per pixel with the best colour in each cell, 0 to about 4.
    fn render_error(&self, painter: &Painter<'_>) -> f64 {
        let views = &self.views;
        let seen: Vec<Vec<Seen>> = views.par_iter().map(|view| painter.look(view)).collect();
        let cells = painter.best_colors(views, &seen);
        let error = |(v, (view, seen)): (usize, (&&View, &Vec<Seen>))| {
            let of_pixel = |&Seen { pixel, cell }: &Seen| {
                let painted = if cell == NO_CELL { Vec4::ZERO } else { cells[cell as usize] };
                let d = painted - view.image.at(pixel as usize);
                let weight = self.weights.get(v).map_or(1.0, |weights| weights[pixel as usize]);
                f64::from(weight * (d.xyz().length_squared() + COVERAGE_WEIGHT * d.w * d.w))
            };
            seen.iter().map(of_pixel).sum::<f64>() / (view.image.size * view.image.size) as f64
        };
        let errors: Vec<f64> = views.par_iter().zip(&seen).enumerate().map(error).collect();
        errors.iter().sum::<f64>() / views.len().max(1) as f64
    }
}

/// Cell of a pixel that only the source covers.
const NO_CELL: u32 = u32::MAX;

/// A pixel that the mesh or the source covers.
struct Seen {
    /// Its index.
    pixel: u32,
    /// What it sees of the mesh, or [`NO_CELL`].
    cell: u32,
}

struct Painter<'a> {
    mesh: &'a TriMesh,
    motions: &'a Motions,
    double_sided: bool,
    /// Cells along the side of each face's square of barycentric coordinates.
    sides: Vec<u32>,
    /// The first cell of each face, and behind the last one how many there are.
    first: Vec<u32>,
}

impl<'a> Painter<'a> {
    fn new(mesh: &'a TriMesh, motions: &'a Motions, double_sided: bool) -> Self {
        let areas: Vec<f32> = (0..mesh.triangles.len()).map(|t| mesh.area_vector(t).length()).collect();
        let total = areas.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        let side = |area: &f32| ((CELLS * area / total).sqrt() as u32).clamp(1, MOST_ALONG);
        let sides: Vec<u32> = areas.iter().map(side).collect();
        let mut first = vec![0];
        first.extend(sides.iter().scan(0, |sum, side| {
            *sum += side * side;
            Some(*sum)
        }));
        Self { mesh, motions, double_sided, sides, first }
    }

    fn cells(&self) -> usize {
        self.first[self.mesh.triangles.len()] as usize
    }

    /// Every pixel that the mesh or the source covers.
    fn look(&self, view: &View) -> Vec<Seen> {
        let size = view.image.size;
        let mut clip = Vec::new();
        self.motions.project(&self.mesh.positions, &view.camera.view_projection, view.pose, &mut clip);
        let mut raster = Raster::new(size);
        raster.draw(&clip, &self.mesh.triangles, |_| self.double_sided);
        let coefficients: Vec<_> =
            self.mesh.triangles.iter().map(|t| barycentric_coefficients(t.map(|v| clip[v as usize]))).collect();
        let mut seen = Vec::new();
        for y in 0..size {
            let ndc_y = pixel_to_ndc(y, size);
            for x in 0..size {
                let i = y * size + x;
                let id = raster.ids[i];
                if id == EMPTY_PIXEL {
                    if view.image.pixels[i][3] != 0 {
                        seen.push(Seen { pixel: i as u32, cell: NO_CELL });
                    }
                    continue;
                }
                let (b, _) = barycentric_at(&coefficients[id as usize], pixel_to_ndc(x, size), ndc_y);
                let side = self.sides[id as usize];
                let along = |c: f32| ((c * side as f32) as u32).min(side - 1);
                let cell = self.first[id as usize] + along(b.x) * side + along(b.y);
                seen.push(Seen { pixel: i as u32, cell });
            }
        }
        seen
    }

    /// The best colour of each cell: the mean over the views.
    fn best_colors(&self, views: &[&View], seen: &[Vec<Seen>]) -> Vec<Vec4> {
        // Sums over views in a fixed order: one partial sum per chunk, however many threads there are.
        let chunk = views.len().div_ceil(4).max(1);
        let sums: Vec<Vec<Vec4>> =
            views.par_chunks(chunk).zip(seen.par_chunks(chunk)).map(|(views, seen)| self.sums(views, seen)).collect();
        let mut cells = vec![Vec4::ZERO; self.cells()];
        for partial in &sums {
            cells.iter_mut().zip(partial).for_each(|(a, b)| *a += *b);
        }
        cells.iter_mut().for_each(|c| *c = if c.w > 0.0 { *c / c.w } else { Vec4::new(0.5, 0.5, 0.5, 1.0) });
        cells
    }

    /// For each cell, the sum of the source's pixels that it covers wholly.
    fn sums(&self, views: &[&View], seen: &[Vec<Seen>]) -> Vec<Vec4> {
        let mut cells = vec![Vec4::ZERO; self.cells()];
        for (view, seen) in views.iter().zip(seen) {
            for &Seen { pixel, cell } in seen.iter().filter(|seen| seen.cell != NO_CELL) {
                let target = view.image.at(pixel as usize);
                if target.w > 0.999 {
                    cells[cell as usize] += target;
                }
            }
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn faces_have_cells_by_their_area() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, 4.0 * Vec3::X, 4.0 * Vec3::Y];
        let mesh = TriMesh { positions, triangles: vec![[0, 1, 2], [0, 3, 4], [0, 1, 1]] };
        let motions = Motions::default();
        let painter = Painter::new(&mesh, &motions, false);
        assert_eq!((painter.sides[0], painter.sides[1], painter.sides[2]), (62, 248, 1));
        assert_eq!(painter.cells(), 62 * 62 + 248 * 248 + 1);
    }
}
