//! How far a level is from its source.

/// Distances between a level and the visible part of its source, both ways, as fractions of the diagonal of the source's
/// bounding box.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Deviation {
    /// Mean distance.
    pub mean: f32,
    /// Distance that 95 % of the points stay within.
    pub percentile_95: f32,
    /// Largest distance (Hausdorff, over the points taken).
    pub max: f32,
}
