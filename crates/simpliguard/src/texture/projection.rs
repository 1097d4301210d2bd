//! The initial texture of the paper's section 3.3: copied from the source's texture, pixel by pixel of images.
//!
//! The source and the level are drawn from the same cameras. A pixel that both cover relates a point of the level's texture
//! to one of the source's. A circle of texels around the first takes the colours around the second, at equal distances in
//! texels of either ("cycle points"). With a radius of zero, a pixel gives one texel ("single point").

use glam::{IVec2, Vec2, Vec3, Vec4};

use super::bake::{BakeTarget, Baker, texel_areas};
use crate::Cancellation;
use crate::data::{TriMesh, area_vector};
use crate::render::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc};
use crate::render::{Camera, EMPTY_PIXEL, Footprint, Raster, Rect};

/// The cameras of a projection.
#[derive(Clone, Copy)]
pub struct Projection<'a> {
    /// The cameras, in their order: later ones win.
    pub cameras: &'a [Camera],
    /// Side of an image in pixels.
    pub size: usize,
    /// Radius of the circles in texels.
    pub radius: u32,
}

impl Baker<'_> {
    /// The colours that the images give to the texels, in linear light; `None` for a texel that no pixel reaches. Among the
    /// pixels that reach a texel, the last one wins.
    ///
    /// If cancelled, the remaining ones are `None`.
    pub fn project(
        &self,
        target: &BakeTarget<'_>,
        projection: &Projection<'_>,
        cancellation: &Cancellation,
    ) -> Vec<Option<Vec4>> {
        let surface = &self.sampler.model().surface;
        let source = TriMesh { positions: surface.positions.clone(), triangles: surface.triangles.clone() };
        let (size, areas, circle) = (target.texels.size, texel_areas(target), circle(projection.radius as i32));
        let mut colors = vec![None; size * size];
        let mut buffers = [Image::new(projection.size), Image::new(projection.size)];
        // From the last pixel to the first: what is known already was won by a later one.
        for camera in projection.cameras.iter().rev().take_while(|_| !cancellation.is_cancelled()) {
            let [of_source, of_level] = &mut buffers;
            of_source.draw(camera, &source, |t| self.sampler.material(t).double_sided);
            of_level.draw(camera, target.mesh, |_| true);
            for pixel in (0..projection.size * projection.size).rev() {
                let (Some((t, b)), Some((face, place))) =
                    (of_source.at(&source, pixel), of_level.at(target.mesh, pixel))
                else {
                    continue;
                };
                let corners = surface.triangles[t].map(|v| surface.positions[v as usize]);
                let footprint = Footprint::new(areas[face], 0.5 * area_vector(corners).length());
                let [u, v, w] = target.atlas.uvs[face];
                let centre = ((u * place.x + v * place.y + w * place.z) * size as f32).as_ivec2();
                for offset in circle.iter().rev() {
                    let texel = centre + *offset;
                    if texel.cmplt(IVec2::ZERO).any() || texel.cmpge(IVec2::splat(size as i32)).any() {
                        continue;
                    }
                    let i = texel.y as usize * size + texel.x as usize;
                    if colors[i].is_none() && target.texels.texels[i].is_some() {
                        let b = self.sampler.shifted(t, b, offset.as_vec2());
                        colors[i] = Some(self.sampler.color(t, b, footprint));
                    }
                }
            }
        }
        colors
    }
}

/// Offsets within a circle, by rows.
fn circle(radius: i32) -> Vec<IVec2> {
    let side = -radius..=radius;
    let all = side.clone().flat_map(|y| side.clone().map(move |x| IVec2::new(x, y)));
    all.filter(|offset| offset.length_squared() <= radius * radius).collect()
}

/// The triangle under each pixel of an image.
struct Image {
    raster: Raster,
    clip: Vec<Vec4>,
}

impl Image {
    fn new(size: usize) -> Self {
        Self { raster: Raster::new(size), clip: Vec::new() }
    }

    fn draw(&mut self, camera: &Camera, mesh: &TriMesh, double_sided: impl Fn(usize) -> bool) {
        let size = self.raster.size;
        camera.project_into(&mesh.positions, &mut self.clip);
        self.raster.clear(Rect { x0: 0, y0: 0, x1: size, y1: size });
        self.raster.draw(&self.clip, &mesh.triangles, double_sided);
    }

    /// The triangle and the barycentric coordinates at a pixel.
    fn at(&self, mesh: &TriMesh, pixel: usize) -> Option<(usize, Vec3)> {
        let (size, id) = (self.raster.size, self.raster.ids[pixel]);
        let t = (id != EMPTY_PIXEL).then_some(id as usize)?;
        let coefficients = barycentric_coefficients(mesh.triangles[t].map(|v| self.clip[v as usize]));
        let ndc = Vec2::new(pixel_to_ndc(pixel % size, size), pixel_to_ndc(pixel / size, size));
        Some((t, barycentric_at(&coefficients, ndc.x, ndc.y).0))
    }
}
