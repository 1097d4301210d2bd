//! Scores a low-poly mesh by rendering, before it has texture coordinates.
//!
//! Each face is divided into cells, in proportion to its area. The best colour of a cell is the mean of the source's
//! pixels there, over all views. Every cell is painted with its best colour. The remaining difference, with the pixels
//! in which the silhouettes disagree, is the error that no texture of that resolution removes.

use glam::{Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use super::inputs::Inputs;
use super::shape::Shape;
use crate::animation::Motions;
use crate::data::{AlphaMode, Candidate, Material, TriMesh};
use crate::geometry::self_intersection;
use crate::render::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc};
use crate::render::{EMPTY_PIXEL, Raster, View};

/// Every this many views, one scores shapes.
const VIEW_STRIDE: usize = 3;
/// Approximate number of cells over the whole mesh.
const CELLS: f32 = 65_536.0;
/// Most cells along the side of a face.
const MOST_ALONG: u32 = 256;
/// Weight of the squared coverage error against those of the three colours.
const COVERAGE_WEIGHT: f32 = 1.5;

/// A level that may be cut out is so if more than one point in this many is clear.
const CLEAR_POINTS: usize = 20;

/// True if a level of the source's own triangles is a cut-out: a good fraction of its points, or texels, is clear.
pub fn is_cut_out(clear: usize, points: usize) -> bool {
    CLEAR_POINTS * clear > points
}

/// Scores shapes by one view in [`VIEW_STRIDE`].
pub(super) struct Scorer<'a> {
    views: Vec<&'a View>,
    /// A weight for each pixel of each view; empty if all count alike.
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
        shape.render_error = self.render_error(&Painter::new(inputs, shape, &motions));
        shape.deviation = inputs.deviation_metric.measure(&shape.mesh);
        shape.self_intersecting = self_intersection::count(&shape.mesh);
    }

    /// Mean squared error per pixel with the best colour in each cell, 0 to about 4.
    fn render_error(&self, painter: &Painter<'_>) -> f64 {
        let views = &self.views;
        let covered: Vec<Vec<CoveredPixel>> = views.par_iter().map(|view| painter.covered_pixels(view)).collect();
        let cells = painter.best_colors(views, &covered);
        let error = |(v, (view, covered)): (usize, (&&View, &Vec<CoveredPixel>))| {
            let of_pixel = |&CoveredPixel { pixel, cell }: &CoveredPixel| {
                let painted = if cell == NO_CELL { Vec4::ZERO } else { cells[cell as usize] };
                let d = painted - view.image.at(pixel as usize);
                let weight = self.weights.get(v).map_or(1.0, |weights| weights[pixel as usize]);
                f64::from(weight * (d.xyz().length_squared() + COVERAGE_WEIGHT * d.w * d.w))
            };
            covered.iter().map(of_pixel).sum::<f64>() / (view.image.size * view.image.size) as f64
        };
        let errors: Vec<f64> = views.par_iter().zip(&covered).enumerate().map(error).collect();
        errors.iter().sum::<f64>() / views.len().max(1) as f64
    }
}

/// The cell of a pixel that only the source covers.
const NO_CELL: u32 = u32::MAX;

/// A pixel that the mesh or the source covers.
struct CoveredPixel {
    /// Index of the pixel in its view.
    pixel: u32,
    /// Cell of the mesh that the pixel shows, or [`NO_CELL`].
    cell: u32,
}

/// Divides the faces of a mesh into cells, and finds the best colour of each.
struct Painter<'a> {
    mesh: &'a TriMesh,
    motions: &'a Motions,
    double_sided: bool,
    /// Cells along the side of each face's square of barycentric coordinates.
    sides: Vec<u32>,
    /// The first cell of each face, followed by the number of all cells.
    first: Vec<u32>,
    /// For each cell, true if it is not cut out. Empty if none is.
    shown: Vec<bool>,
}

impl<'a> Painter<'a> {
    fn new(inputs: &Inputs<'_>, shape: &'a Shape, motions: &'a Motions) -> Self {
        let mut painter = Self::opaque(&shape.mesh, motions, shape.double_sided);
        painter.shown = painter.shown_cells(inputs, shape);
        painter
    }

    fn opaque(mesh: &'a TriMesh, motions: &'a Motions, double_sided: bool) -> Self {
        let areas: Vec<f32> = (0..mesh.triangles.len()).map(|t| mesh.area_vector(t).length()).collect();
        let total = areas.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        let side = |area: &f32| ((CELLS * area / total).sqrt() as u32).clamp(1, MOST_ALONG);
        let sides: Vec<u32> = areas.iter().map(side).collect();
        let mut first = vec![0];
        first.extend(sides.iter().scan(0, |sum, side| {
            *sum += side * side;
            Some(*sum)
        }));
        Self { mesh, motions, double_sided, sides, first, shown: Vec::new() }
    }

    /// For each cell of cards, and of the source's own triangles if any of them is cut out, true if it is not cut out.
    fn shown_cells(&self, inputs: &Inputs<'_>, shape: &Shape) -> Vec<bool> {
        let is_masked = |m: &Material| matches!(m.alpha_mode, AlphaMode::Mask { .. });
        let may_cut = shape.candidate == Candidate::Source && inputs.model.materials.iter().any(is_masked);
        if shape.cards.is_none() && !may_cut {
            return Vec::new();
        }
        let points: Vec<(u32, Vec3)> =
            self.sides.iter().zip(0..).flat_map(|(&side, face)| cell_centres(face, side)).collect();
        let area = |(t, &side): (usize, &u32)| 0.5 * self.mesh.area_vector(t).length() / (side * side) as f32;
        let areas: Vec<f32> = self.sides.iter().enumerate().map(area).collect();
        let shown = inputs.tools.shown(self.mesh, shape.cards.as_ref(), &points, &areas);
        let clear = shown.iter().filter(|shown| !**shown).count();
        if shape.cards.is_some() || is_cut_out(clear, shown.len()) { shown } else { Vec::new() }
    }

    /// The cell of a face at barycentric coordinates.
    fn cell(&self, face: usize, b: Vec3) -> u32 {
        let side = self.sides[face];
        let along = |c: f32| ((c * side as f32) as u32).min(side - 1);
        self.first[face] + along(b.x) * side + along(b.y)
    }

    fn cells(&self) -> usize {
        self.first[self.mesh.triangles.len()] as usize
    }

    /// All pixels of a view that the mesh or the source covers.
    fn covered_pixels(&self, view: &View) -> Vec<CoveredPixel> {
        let size = view.image.size;
        let mut clip = Vec::new();
        self.motions.project(&self.mesh.positions, &view.camera.view_projection, view.pose, &mut clip);
        let coefficients: Vec<_> =
            self.mesh.triangles.iter().map(|t| barycentric_coefficients(t.map(|v| clip[v as usize]))).collect();
        let cell = |t: usize, x: usize, y: usize| {
            let (b, _) = barycentric_at(&coefficients[t], pixel_to_ndc(x, size), pixel_to_ndc(y, size));
            self.cell(t, b)
        };
        let mut raster = Raster::new(size);
        if self.shown.is_empty() {
            raster.draw(&clip, &self.mesh.triangles, |_| self.double_sided);
        } else {
            let corners = raster.pixel_corners(&clip);
            for (t, triangle) in self.mesh.triangles.iter().enumerate() {
                let is_shown = |_, x, y| self.shown[cell(t, x, y) as usize];
                raster.draw_tested(t, triangle.map(|v| corners[v as usize]), true, is_shown);
            }
        }
        let mut covered = Vec::new();
        for y in 0..size {
            for x in 0..size {
                let i = y * size + x;
                let id = raster.ids[i];
                if id == EMPTY_PIXEL {
                    if view.image.pixels[i][3] != 0 {
                        covered.push(CoveredPixel { pixel: i as u32, cell: NO_CELL });
                    }
                    continue;
                }
                covered.push(CoveredPixel { pixel: i as u32, cell: cell(id as usize, x, y) });
            }
        }
        covered
    }

    /// The best colour of each cell: the mean over the views; grey for a cell that no view shows.
    fn best_colors(&self, views: &[&View], covered: &[Vec<CoveredPixel>]) -> Vec<Vec4> {
        // The order of the sums does not depend on the number of threads: one partial sum for each of at most four
        // chunks.
        let chunk = views.len().div_ceil(4).max(1);
        let sums: Vec<Vec<Vec4>> = views
            .par_chunks(chunk)
            .zip(covered.par_chunks(chunk))
            .map(|(views, covered)| self.sums(views, covered))
            .collect();
        let mut cells = vec![Vec4::ZERO; self.cells()];
        for partial in &sums {
            cells.iter_mut().zip(partial).for_each(|(a, b)| *a += *b);
        }
        cells.iter_mut().for_each(|c| *c = if c.w > 0.0 { *c / c.w } else { Vec4::new(0.5, 0.5, 0.5, 1.0) });
        cells
    }

    /// For each cell, the sum of the source's fully covered pixels there.
    fn sums(&self, views: &[&View], covered: &[Vec<CoveredPixel>]) -> Vec<Vec4> {
        let mut cells = vec![Vec4::ZERO; self.cells()];
        for (view, covered) in views.iter().zip(covered) {
            for &CoveredPixel { pixel, cell } in covered.iter().filter(|pixel| pixel.cell != NO_CELL) {
                let target = view.image.at(pixel as usize);
                if target.w > 0.999 {
                    cells[cell as usize] += target;
                }
            }
        }
        cells
    }
}

/// The face and the barycentric coordinates of the centre of each cell, in the order of the cells. Cells beyond the face's
/// third edge are mirrored into it.
fn cell_centres(face: u32, side: u32) -> impl Iterator<Item = (u32, Vec3)> {
    (0..side * side).map(move |cell| {
        let [x, y] = [cell / side, cell % side].map(|i| (i as f32 + 0.5) / side as f32);
        let over = (x + y - 1.0).max(0.0);
        let (x, y) = (x - over, y - over);
        (face, Vec3::new(x, y, 1.0 - x - y))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Model, Surface};
    use crate::geometry::BoundingSphere;
    use crate::render::{Camera, Sampling, SurfaceSampler, take_views};

    #[test]
    fn faces_have_cells_by_their_area() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, 4.0 * Vec3::X, 4.0 * Vec3::Y];
        let mesh = TriMesh { positions, triangles: vec![[0, 1, 2], [0, 3, 4], [0, 1, 1]] };
        let motions = Motions::default();
        let painter = Painter::opaque(&mesh, &motions, false);
        assert_eq!((painter.sides[0], painter.sides[1], painter.sides[2]), (62, 248, 1));
        assert_eq!(painter.cells(), 62 * 62 + 248 * 248 + 1);
    }
    #[test]
    fn the_centre_of_each_cell_lies_in_it_or_on_the_edge() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let mesh = TriMesh { positions, triangles: vec![[0, 1, 2]] };
        let motions = Motions::default();
        let painter = Painter::opaque(&mesh, &motions, false);
        let side = painter.sides[0];
        for (cell, (face, b)) in (0..).zip(cell_centres(0, side)) {
            assert!(face == 0 && b.min_element() > -1e-6 && (b.element_sum() - 1.0).abs() < 1e-6, "{b}");
            let is_inside = cell / side + cell % side + 1 < side;
            assert!(!is_inside || painter.cell(0, b) == cell, "{cell} {b}");
        }
    }

    #[test]
    fn what_is_cut_out_of_a_face_covers_no_pixel() {
        let positions = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
        let surface = Surface { positions, triangles: vec![[0, 1, 2]], material: vec![0], ..Surface::default() };
        let model = Model { surface, materials: vec![Material::default()], ..Model::empty("leaf") };
        let camera = Camera::orbit(&BoundingSphere::around(&model.surface.positions), Vec3::Z, 0.6, 1.0);
        let sampler = SurfaceSampler::new(&model);
        let view = &take_views(&sampler, &[camera], Sampling::antialiased(32))[0];
        let mesh = TriMesh { positions: model.surface.positions.clone(), triangles: vec![[0, 1, 2]] };
        let motions = Motions::default();
        let mut painter = Painter::opaque(&mesh, &motions, false);
        let shown =
            |painter: &Painter<'_>| painter.covered_pixels(view).iter().filter(|pixel| pixel.cell != NO_CELL).count();
        let whole = shown(&painter);
        painter.shown = vec![true; painter.cells()];
        assert_eq!(shown(&painter), whole);
        // What is nearer to the first corner than the opposite edge is: a triangle of half the height.
        let side = painter.sides[0];
        painter.shown = (0..painter.cells() as u32).map(|cell| cell / side >= side / 2).collect();
        let part = shown(&painter) as f32 / whole as f32;
        assert!((part - 0.25).abs() < 0.05, "{part}");
        painter.shown = vec![false; painter.cells()];
        assert_eq!(shown(&painter), 0);
    }
}
