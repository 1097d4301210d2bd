//! Scanline rasterisation into a visibility buffer: the visible triangle of each pixel, and its depth.

use glam::{Vec2, Vec3, Vec4};

/// Triangle of a pixel that no triangle covers.
pub const EMPTY_PIXEL: u32 = u32::MAX;

/// A half-open rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// One past the last column.
    pub x1: usize,
    /// One past the last row.
    pub y1: usize,
}

impl Rect {
    /// The pixels that triangles with corners at `clip` may cover in an image of `size`, extended by `margin` pixels.
    pub fn around(clip: &[Vec4], size: usize, margin: usize) -> Self {
        let (mut low, mut high) = (Vec2::splat(f32::MAX), Vec2::splat(f32::MIN));
        for p in clip.iter().map(|&c| to_pixels(c, size)) {
            low = low.min(p.truncate());
            high = high.max(p.truncate());
        }
        let clamped = |v: f32| v.clamp(0.0, size as f32) as usize;
        Self {
            x0: clamped(low.x).saturating_sub(margin),
            y0: clamped(low.y).saturating_sub(margin),
            x1: (clamped(high.x + 1.0) + margin).min(size),
            y1: (clamped(high.y + 1.0) + margin).min(size),
        }
    }

    /// The rectangle extended to whole blocks of `n` x `n` pixels.
    pub fn aligned(&self, n: usize) -> Self {
        let up = |x: usize| x.next_multiple_of(n);
        Self { x0: self.x0 / n * n, y0: self.y0 / n * n, x1: up(self.x1), y1: up(self.y1) }
    }

    /// True if a pixel lies within.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        self.rows().contains(&y) && self.columns().contains(&x)
    }

    /// Rows of the rectangle.
    pub fn rows(&self) -> std::ops::Range<usize> {
        self.y0..self.y1.max(self.y0)
    }

    /// Columns of the rectangle.
    pub fn columns(&self) -> std::ops::Range<usize> {
        self.x0..self.x1.max(self.x0)
    }
}

/// From clip space to pixels of a square image: pixel centres are at whole numbers, row 0 is at the bottom, z is the
/// depth.
#[inline]
pub fn to_pixels(clip: Vec4, size: usize) -> Vec3 {
    let inverse = 1.0 / clip.w;
    let half = 0.5 * size as f32;
    Vec3::new(clip.x * inverse * half + half - 0.5, clip.y * inverse * half + half - 0.5, clip.z * inverse)
}

/// Normalised device coordinate of the centre of pixel `i` of `size`.
#[inline]
pub(crate) fn pixel_to_ndc(i: usize, size: usize) -> f32 {
    (2 * i + 1) as f32 / size as f32 - 1.0
}

/// A square visibility buffer.
pub struct Raster {
    /// Side in pixels.
    pub size: usize,
    /// Visible triangle of each pixel, or [`EMPTY_PIXEL`]; rows from the bottom.
    pub ids: Vec<u32>,
    /// Depth of each pixel, -1 near to 1 far; `f32::MAX` for an empty pixel.
    pub depth: Vec<f32>,
    /// Corners in pixels of the last [`Self::draw`], kept for their memory.
    corners: Vec<Vec3>,
}

/// A triangle set up for scan conversion.
struct Setup {
    corners: [Vec3; 3],
    /// The depth at pixel `(x, y)` is `plane.x + plane.y * x + plane.z * y`.
    plane: Vec3,
}

impl Raster {
    /// An empty buffer.
    pub fn new(size: usize) -> Self {
        Self { size, ids: vec![EMPTY_PIXEL; size * size], depth: vec![f32::MAX; size * size], corners: Vec::new() }
    }

    /// Empties the pixels within `rect`.
    pub fn clear(&mut self, rect: Rect) {
        for y in rect.rows() {
            let row = y * self.size;
            self.ids[row + rect.x0..row + rect.x1.max(rect.x0)].fill(EMPTY_PIXEL);
            self.depth[row + rect.x0..row + rect.x1.max(rect.x0)].fill(f32::MAX);
        }
    }

    /// Draws opaque triangles. Back faces are drawn only where `double_sided(t)`.
    pub fn draw(&mut self, clip: &[Vec4], triangles: &[[u32; 3]], double_sided: impl Fn(usize) -> bool) {
        let mut pixels = std::mem::take(&mut self.corners);
        pixels.clear();
        pixels.extend(self.corners_in_pixels(clip));
        for (t, triangle) in triangles.iter().enumerate() {
            let corners = triangle.map(|v| pixels[v as usize]);
            // Most triangles of a dense mesh lie between pixels.
            if !may_cover(&corners, self.size) {
                continue;
            }
            if let Some(setup) = set_up(corners, || double_sided(t)) {
                self.fill_opaque(t as u32, &setup);
            }
        }
        self.corners = pixels;
    }

    /// Corners in pixels, for [`Raster::draw_tested`]; not a number behind the camera.
    pub(crate) fn pixel_corners(&self, clip: &[Vec4]) -> Vec<Vec3> {
        self.corners_in_pixels(clip).collect()
    }

    fn corners_in_pixels(&self, clip: &[Vec4]) -> impl Iterator<Item = Vec3> {
        let size = self.size;
        clip.iter().map(move |&c| if c.w > 0.0 { to_pixels(c, size) } else { Vec3::NAN })
    }

    /// Draws triangle `t`. Calls `visit(buffer index, x, y)` for each of its pixels that passes the depth test, and
    /// writes the pixel if that returns true.
    pub(crate) fn draw_tested(
        &mut self,
        t: usize,
        corners: [Vec3; 3],
        double_sided: bool,
        mut visit: impl FnMut(usize, usize, usize) -> bool,
    ) {
        if !may_cover(&corners, self.size) {
            return;
        }
        let Some(setup) = set_up(corners, || double_sided) else { return };
        let size = self.size;
        scan(&setup.corners, size, |y, x0, x1| {
            for x in x0..x1 {
                let z = setup.plane.x + setup.plane.y * x as f32 + setup.plane.z * y as f32;
                let i = y * size + x;
                if z < self.depth[i] && visit(i, x, y) {
                    self.ids[i] = t as u32;
                    self.depth[i] = z;
                }
            }
        });
    }

    #[inline]
    fn fill_opaque(&mut self, id: u32, setup: &Setup) {
        let size = self.size;
        let (ids, depth) = (&mut self.ids, &mut self.depth);
        scan(&setup.corners, size, |y, x0, x1| {
            let start = setup.plane.x + setup.plane.z * y as f32;
            let span = y * size + x0..y * size + x1;
            let pixels = depth[span.clone()].iter_mut().zip(&mut ids[span]);
            for (x, (depth, pixel)) in (x0 as i32..x1 as i32).zip(pixels) {
                let z = start + setup.plane.y * x as f32;
                // Masks instead of branches: half of the pixels of layered triangles fail the test, at random.
                let nearer = u32::from(z < *depth).wrapping_neg();
                *depth = f32::from_bits(z.to_bits() & nearer | depth.to_bits() & !nearer);
                *pixel = id & nearer | *pixel & !nearer;
            }
        });
    }
}

/// True if the rectangle around a triangle contains the centre of a pixel.
#[inline]
fn may_cover([a, b, c]: &[Vec3; 3], size: usize) -> bool {
    let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
    let contains = |low: f32, high: f32| first_centre(low, size as f32) < first_centre(high, size as f32);
    contains(low.x, high.x) && contains(low.y, high.y)
}

/// The set-up of a triangle; `None` if it is not drawn.
fn set_up(corners: [Vec3; 3], double_sided: impl Fn() -> bool) -> Option<Setup> {
    let [a, b, c] = corners;
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if area.is_nan() || area.abs() <= 1e-12 || (area < 0.0 && !double_sided()) {
        return None;
    }
    let zx = ((b.z - a.z) * (c.y - a.y) - (c.z - a.z) * (b.y - a.y)) / area;
    let zy = ((c.z - a.z) * (b.x - a.x) - (b.z - a.z) * (c.x - a.x)) / area;
    Some(Setup { corners, plane: Vec3::new(a.z - zx * a.x - zy * a.y, zx, zy) })
}

/// Calls `span(y, x0, x1)` for each row of pixel centres inside a triangle. Two triangles that share an edge evaluate
/// it alike: no pixel between them is left out, and none is drawn twice.
#[inline]
pub(crate) fn scan(corners: &[Vec3; 3], size: usize, mut span: impl FnMut(usize, usize, usize)) {
    let [low, middle, high] = by_height(corners.map(|c| c.truncate()));
    let limit = size as f32;
    let (y0, y1) = (first_centre(low.y, limit), first_centre(high.y, limit));
    for y in y0..y1 {
        let yf = y as f32;
        let long = edge_at(low, high, yf);
        let short = if yf < middle.y { edge_at(low, middle, yf) } else { edge_at(middle, high, yf) };
        let (left, right) = if long < short { (long, short) } else { (short, long) };
        let (x0, x1) = (first_centre(left, limit), first_centre(right, limit));
        if x0 < x1 {
            span(y, x0, x1);
        }
    }
}

/// Three points from the lowest to the highest.
#[inline]
fn by_height([a, b, c]: [Vec2; 3]) -> [Vec2; 3] {
    let sorted = |a: Vec2, b: Vec2| {
        let is_higher = a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x)).is_gt();
        if is_higher { (b, a) } else { (a, b) }
    };
    let (a, b) = sorted(a, b);
    let (b, c) = sorted(b, c);
    let (a, b) = sorted(a, b);
    [a, b, c]
}

/// `x` rounded up, clamped to 0 and `limit`. `f32::ceil` would be a function call on targets without a rounding
/// instruction.
#[inline]
fn first_centre(x: f32, limit: f32) -> usize {
    let x = x.clamp(0.0, limit);
    let whole = x as i32;
    (whole + i32::from((whole as f32) < x)) as usize
}

#[inline]
fn edge_at(low: Vec2, high: Vec2, y: f32) -> f32 {
    let height = high.y - low.y;
    if height <= 0.0 { high.x } else { low.x + (high.x - low.x) * ((y - low.y) / height) }
}

/// Coefficients `k_i` of the homogeneous barycentric coordinates of a triangle in clip space (Olano and Greer 1997):
/// `a_i = k_i.x + k_i.y * x + k_i.z * y` at normalised device coordinates `(x, y)`. Divided by their sum they are
/// perspective-correct.
#[inline]
pub(crate) fn barycentric_coefficients(clip: [Vec4; 3]) -> [Vec3; 3] {
    let f = |p: Vec4, q: Vec4| Vec3::new(p.x * q.y - p.y * q.x, p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w);
    [f(clip[1], clip[2]), f(clip[2], clip[0]), f(clip[0], clip[1])]
}

/// Perspective-correct barycentric coordinates, and the inverse of the sum of the homogeneous ones.
#[inline]
pub(crate) fn barycentric_at(coefficients: &[Vec3; 3], x: f32, y: f32) -> (Vec3, f32) {
    let at = |k: Vec3| k.x + k.y * x + k.z * y;
    let a = Vec3::new(at(coefficients[0]), at(coefficients[1]), at(coefficients[2]));
    let inverse = 1.0 / (a.x + a.y + a.z);
    (a * inverse, inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(x: f32, y: f32, z: f32) -> Vec4 {
        Vec4::new(x, y, z, 1.0)
    }

    #[test]
    fn two_triangles_of_a_quad_cover_each_pixel_once() {
        let corners = [clip(-0.7, -0.9, 0.0), clip(0.8, -0.6, 0.0), clip(0.9, 0.7, 0.0), clip(-0.8, 0.8, 0.0)];
        let count = |triangles: &[[u32; 3]]| {
            let mut raster = Raster::new(64);
            raster.draw(&corners, triangles, |_| false);
            raster.ids.iter().filter(|&&id| id != EMPTY_PIXEL).count()
        };
        let whole = count(&[[0, 1, 2], [0, 2, 3]]);
        assert_eq!(whole, count(&[[0, 1, 2]]) + count(&[[0, 2, 3]]));
        assert_eq!(whole, count(&[[0, 1, 3], [1, 2, 3]]));
    }

    #[test]
    fn centres_are_found_as_by_rounding_up() {
        for x in [-1.0f32, -0.0, 0.2, 1.0, 1.000_000_1, 63.5, 64.0, 1e9, f32::INFINITY, f32::NAN] {
            assert_eq!(first_centre(x, 64.0), x.ceil().clamp(0.0, 64.0) as usize, "{x}");
        }
    }

    #[test]
    fn the_nearer_triangle_wins_in_any_order() {
        let corners = [
            clip(-1.0, -1.0, 0.5),
            clip(3.0, -1.0, 0.5),
            clip(-1.0, 3.0, 0.5),
            clip(-1.0, -1.0, 0.1),
            clip(3.0, -1.0, 0.1),
            clip(-1.0, 3.0, 0.1),
        ];
        for order in [[[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]] {
            let mut raster = Raster::new(4);
            raster.draw(&corners, &order, |_| false);
            let near = order.iter().position(|t| t[0] == 3).expect("drawn") as u32;
            assert!(raster.ids.iter().all(|&id| id == near));
        }
    }

    #[test]
    fn back_faces_need_two_sides() {
        let corners = [clip(-1.0, -1.0, 0.0), clip(-1.0, 1.0, 0.0), clip(1.0, -1.0, 0.0)];
        for (double_sided, seen) in [(false, false), (true, true)] {
            let mut raster = Raster::new(8);
            raster.draw(&corners, &[[0, 1, 2]], |_| double_sided);
            assert_eq!(raster.ids.contains(&0), seen);
        }
    }

    #[test]
    fn poison_positions_draw_nothing() {
        for bad in [f32::NAN, f32::INFINITY] {
            let corners = [clip(bad, 0.0, 0.0), clip(1.0, 0.0, 0.0), clip(0.0, 1.0, 0.0)];
            let mut raster = Raster::new(8);
            raster.draw(&corners, &[[0, 1, 2]], |_| true);
            assert!(raster.depth.iter().all(|d| !d.is_nan()));
        }
    }

    #[test]
    fn barycentrics_are_perspective_correct() {
        // Halfway on the screen between depths 1 and 3 is a quarter of the length in space.
        let corners = [Vec4::new(0.0, 0.0, 0.0, 1.0), Vec4::new(3.0, 0.0, 0.0, 3.0), Vec4::new(0.0, 1.0, 0.0, 1.0)];
        let (b, _) = barycentric_at(&barycentric_coefficients(corners), 0.5, 0.0);
        assert!((b - Vec3::new(0.75, 0.25, 0.0)).length() < 1e-6, "{b}");
    }
}
