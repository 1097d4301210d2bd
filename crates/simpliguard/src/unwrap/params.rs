//! The parameters of the stage.

/// Size and spacing of an atlas.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct UnwrapParams {
    /// Side of the square atlas in texels; at least 1.
    pub size: u32,
    /// Least number of uncovered texels between two charts. Half of it, rounded up, is kept to the border, so that
    /// charts stay as far apart across a repeating border.
    pub gutter: u32,
}

impl Default for UnwrapParams {
    fn default() -> Self {
        Self { size: 1024, gutter: 4 }
    }
}
