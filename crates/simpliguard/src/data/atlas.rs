//! The atlas of a level.

use glam::Vec2;

/// Texture coordinates of every face of a mesh.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Atlas {
    /// Coordinates of the corners of each face in `[0, 1]`, origin at the top left; texel `x` has its centre at
    /// `(x + 0.5) / size`. Every face has positive signed area as `(u, v)` numbers.
    pub uvs: Vec<[Vec2; 3]>,
    /// Chart of each face, from 0. Within a chart, corners at one vertex of the chart have equal coordinates.
    pub chart: Vec<u32>,
    /// Number of charts.
    pub charts: usize,
    /// Part of all texels whose centre is covered by a face.
    pub fill: f32,
    /// Area-weighted L2 stretch (Sander et al. 2001) relative to each chart's mean density; 1 = isometric.
    pub stretch: f32,
    /// The same in the L-infinity norm: the largest of any face.
    pub worst_stretch: f32,
    /// Texels per unit of length where the importance is 1.
    pub texels_per_unit: f32,
}
