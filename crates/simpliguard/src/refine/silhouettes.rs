//! Where silhouette edges pass between the centres of neighbouring pixels.
//!
//! Edges are walked, not pixels. Near the silhouette of a smooth surface, faces lie so much on edge that they cover no
//! pixel's centre: the pixel beside the edge shows another face, by which the edge would not be found.

use glam::{Vec3, Vec3Swizzles, Vec4};

use super::low_poly::{LowPoly, NO_NEIGHBOUR};
use crate::render::raster::to_pixels;
use crate::render::{EMPTY_PIXEL, Raster, Rect};

/// Largest difference in depth between an edge and what the pixel beside it shows, if both are one surface. The depth of a
/// model extends over about two.
const SAME_SURFACE: f32 = 0.2;

/// One blend across a silhouette edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blend {
    /// The pixel within the silhouette, and the one beyond it.
    pub(super) near: u32,
    pub(super) far: u32,
    /// Distance from the near pixel's centre to the edge, in pixels towards the far one, 0 to 1.
    pub(super) reach: f32,
    /// Ends of the edge.
    pub(super) vertices: [u32; 2],
    /// The pixels are side by side, else one above the other.
    pub(super) horizontal: bool,
    /// +1 if the far pixel follows the near one along that direction.
    pub(super) sign: f32,
}

/// The silhouette edges of one view, reused from view to view.
#[derive(Default)]
pub(super) struct Silhouettes {
    /// One for each pair of pixels that an edge passes between.
    pub(super) blends: Vec<Blend>,
    /// Position of each vertex in pixels, and its depth.
    pixels: Vec<Vec3>,
    /// Triangles that face the camera.
    facing: Vec<bool>,
}

impl Silhouettes {
    /// Finds the blends of a mesh with its vertices at `clip`, of which `raster` shows what is visible within `rect`.
    pub(super) fn find(&mut self, low: &LowPoly, clip: &[Vec4], raster: &Raster, rect: Rect) {
        self.pixels.clear();
        self.pixels.extend(clip.iter().map(|&c| to_pixels(c, raster.size)));
        self.facing.clear();
        let pixels = &self.pixels;
        self.facing.extend(low.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| pixels[v as usize].xy());
            (b - a).perp_dot(c - a) > 0.0
        }));
        self.blends.clear();
        for (t, triangle) in low.triangles.iter().enumerate() {
            for k in 0..3 {
                if self.is_silhouette(low, t, k) {
                    let [a, b, c] = [k, (k + 1) % 3, (k + 2) % 3].map(|corner| triangle[corner]);
                    self.walk([a, b], c, raster, rect);
                }
            }
        }
        // Where several edges of a surface pass between two pixels, the surface ends at the outermost.
        self.blends.sort_by(|a, b| (a.near, a.far).cmp(&(b.near, b.far)).then(b.reach.total_cmp(&a.reach)));
        self.blends.dedup_by_key(|blend| (blend.near, blend.far));
    }

    /// True if edge `k` of triangle `t` is on a silhouette. Of two triangles that share it, only one says so.
    fn is_silhouette(&self, low: &LowPoly, t: usize, k: usize) -> bool {
        match low.neighbours[t][k] {
            NO_NEIGHBOUR => self.facing[t] || low.double_sided,
            across => self.facing[t] && !self.facing[across as usize],
        }
    }

    /// Adds the blends along an edge, whose triangle has its third corner at `inside`. The edge acts along its minor
    /// direction only: with both, diagonals would count twice.
    fn walk(&mut self, vertices: [u32; 2], inside: u32, raster: &Raster, rect: Rect) {
        let [a, b, c] = [vertices[0], vertices[1], inside].map(|v| self.pixels[v as usize]);
        let horizontal = (b.y - a.y).abs() >= (b.x - a.x).abs();
        let swap = |v: Vec3| if horizontal { v.xy() } else { v.yx() };
        let (start, end, inside) = (swap(a), swap(b), swap(c));
        let side = (end - start).perp_dot(inside - start) * (end.y - start.y);
        if side == 0.0 || side.is_nan() {
            return;
        }
        let (columns, rows) = if horizontal { (rect.columns(), rect.rows()) } else { (rect.rows(), rect.columns()) };
        let (low, high) = (start.y.min(end.y).max(rows.start as f32), start.y.max(end.y));
        for row in (low.ceil() as usize..rows.end).take_while(|row| *row as f32 <= high) {
            let t = (row as f32 - start.y) / (end.y - start.y);
            let crossing = start.x + (end.x - start.x) * t;
            if crossing < columns.start as f32 || crossing + 1.0 >= columns.end as f32 {
                continue;
            }
            let first = crossing as usize;
            let (near, far, sign) = if side < 0.0 { (first + 1, first, -1.0) } else { (first, first + 1, 1.0) };
            let index =
                |column: usize| if horizontal { row * raster.size + column } else { column * raster.size + row };
            let reach = (crossing - near as f32) * sign;
            let blend = Blend { near: index(near) as u32, far: index(far) as u32, reach, vertices, horizontal, sign };
            if is_visible(&blend, a.z + (b.z - a.z) * t, raster) {
                self.blends.push(blend);
            }
        }
    }
}

/// True if the near pixel shows the surface that ends at an edge of this `depth`, and the far pixel what lies behind it.
fn is_visible(blend: &Blend, depth: f32, raster: &Raster) -> bool {
    let (near, far) = (blend.near as usize, blend.far as usize);
    let is_covered = raster.ids[near] != EMPTY_PIXEL && raster.ids[near] != raster.ids[far];
    is_covered
        && raster.depth[near] < raster.depth[far]
        && depth < raster.depth[far]
        && (raster.depth[near] - depth).abs() < SAME_SURFACE
}
