//! Scores a low-poly mesh by rendering, before it has texture coordinates.
//!
//! Each face is divided into a few cells. The best colour of a cell is the mean of what the source shows there, over all
//! views; what is left after painting every cell so, together with the pixels the silhouettes disagree on, is the error
//! that no texture of that resolution removes.

use glam::{Vec4, Vec4Swizzles};
use rayon::prelude::*;

use crate::mesh::TriMesh;
use crate::render::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc};
use crate::render::{Motions, NOTHING, Raster, Rect, View};

/// Cells over the whole mesh.
const CELLS: usize = 65_536;
/// Weight of the squared coverage error against those of the three colours.
const COVERAGE_WEIGHT: f32 = 1.5;

/// Mean squared error per pixel over `views` with the best colour in each cell, 0 to about 4. `motions` move the mesh
/// into the poses of the views. `weights` has one list per view with a factor for each of its pixels, or is empty.
pub(super) fn render_error(
    mesh: &TriMesh,
    motions: &Motions,
    double_sided: bool,
    views: &[&View],
    weights: &[Vec<f32>],
) -> f64 {
    let painter = Painter::new(mesh, motions, double_sided);
    // Sums over views in a fixed order: one partial sum per chunk, however many threads there are.
    let sums = views
        .par_chunks(views.len().div_ceil(4).max(1))
        .map(|chunk| {
            let mut cells = vec![Vec4::ZERO; painter.cells()];
            for view in chunk {
                painter.for_each_pixel(view, |_, cell, target| {
                    if let Some(cell) = cell.filter(|_| target.w > 0.999) {
                        cells[cell] += target;
                    }
                });
            }
            cells
        })
        .collect::<Vec<_>>();
    let mut cells = vec![Vec4::ZERO; painter.cells()];
    for part in &sums {
        cells.iter_mut().zip(part).for_each(|(a, b)| *a += *b);
    }
    cells.iter_mut().for_each(|c| *c = if c.w > 0.0 { *c / c.w } else { Vec4::new(0.5, 0.5, 0.5, 1.0) });
    let errors: Vec<f64> = views
        .par_iter()
        .enumerate()
        .map(|(v, view)| {
            let mut error = 0.0;
            painter.for_each_pixel(view, |pixel, cell, target| {
                let d = cell.map_or(Vec4::ZERO, |c| cells[c]) - target;
                let weight = weights.get(v).map_or(1.0, |weights| weights[pixel]);
                error += f64::from(weight * (d.xyz().length_squared() + COVERAGE_WEIGHT * d.w * d.w));
            });
            error / (view.picture.size * view.picture.size) as f64
        })
        .collect();
    errors.iter().sum::<f64>() / views.len().max(1) as f64
}

struct Painter<'a> {
    mesh: &'a TriMesh,
    motions: &'a Motions,
    double_sided: bool,
    /// Cells along the side of a face's square of barycentric coordinates.
    side: usize,
}

impl<'a> Painter<'a> {
    fn new(mesh: &'a TriMesh, motions: &'a Motions, double_sided: bool) -> Self {
        let side = (CELLS as f64 / mesh.triangles.len().max(1) as f64).sqrt() as usize;
        Self { mesh, motions, double_sided, side: side.clamp(2, 8) }
    }

    fn cells(&self) -> usize {
        self.mesh.triangles.len() * self.side * self.side
    }

    /// Visits every pixel that the mesh or the source covers: its index, the cell seen there, if any, and the source's pixel.
    fn for_each_pixel(&self, view: &View, mut visit: impl FnMut(usize, Option<usize>, Vec4)) {
        let size = view.picture.size;
        let mut clip = Vec::new();
        self.motions.project(&self.mesh.positions, &view.camera, view.pose, &mut clip);
        let mut raster = Raster::new(size);
        raster.draw(&clip, &self.mesh.triangles, |_| self.double_sided);
        let coefficients: Vec<_> =
            self.mesh.triangles.iter().map(|t| barycentric_coefficients(t.map(|v| clip[v as usize]))).collect();
        let all = Rect { x0: 0, y0: 0, x1: size, y1: size };
        for y in all.rows() {
            let ndc_y = pixel_to_ndc(y, size);
            for x in all.columns() {
                let i = y * size + x;
                let id = raster.ids[i];
                if id == NOTHING && view.picture.pixels[i][3] == 0 {
                    continue;
                }
                let cell = (id != NOTHING).then(|| {
                    let (b, _) = barycentric_at(&coefficients[id as usize], pixel_to_ndc(x, size), ndc_y);
                    let along = |c: f32| ((c * self.side as f32) as usize).min(self.side - 1);
                    id as usize * self.side * self.side + along(b.x) * self.side + along(b.y)
                });
                visit(i, cell, view.picture.at(i));
            }
        }
    }
}
