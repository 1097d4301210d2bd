use crate::geometry::Bvh;
use crate::render::View;

/// The source, as a mesh is fitted to it.
pub struct ViewTarget<'a> {
    /// Views of the source.
    pub views: &'a [View],
    /// Views at half the resolution, or none.
    pub half_resolution: &'a [View],
    /// Over the source's triangles.
    pub bvh: &'a Bvh,
    /// Radius of the source's bounding sphere.
    pub radius: f32,
    /// Seed of the order in which views are taken.
    pub seed: u64,
}
