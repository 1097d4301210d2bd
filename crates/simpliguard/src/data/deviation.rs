//! The distance between a level and its source.

/// Distances between a level and the visible part of its source, measured in both directions, as fractions of the
/// diagonal of the source's bounding box.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Deviation {
    /// Mean distance.
    pub mean: f32,
    /// Distance within which 95 % of the points lie.
    pub percentile_95: f32,
    /// Largest distance (Hausdorff, over the sampled points).
    pub max: f32,
}
