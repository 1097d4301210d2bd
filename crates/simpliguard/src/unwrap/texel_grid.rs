//! The grid of cells in which charts are placed.

/// Side below which no coarser grid is searched.
const LEAST_COARSE_SIDE: usize = 256;

/// Least area of a chart in texels.
const LEAST_TEXELS: f64 = 1.0;

/// The square grid in which charts are placed.
#[derive(Clone, Copy)]
pub(super) struct TexelGrid {
    /// Cells along a side.
    pub side: usize,
    /// Cells between charts.
    pub gutter: usize,
    /// Cells between a chart and the border.
    pub border: usize,
    /// Least area of a chart in cells.
    pub least_area: f64,
}

impl TexelGrid {
    /// A grid whose cells are texels.
    pub(super) fn new(side: usize, gutter: usize) -> Self {
        Self { side, gutter, border: gutter.div_ceil(2), least_area: LEAST_TEXELS }
    }

    /// The grid of cells twice as wide; charts that fit there fit here. `None` for an odd or a small side.
    pub(super) fn halved(self) -> Option<Self> {
        (self.side.is_multiple_of(2) && self.side >= LEAST_COARSE_SIDE).then(|| Self {
            side: self.side / 2,
            gutter: self.gutter.div_ceil(2),
            border: self.border.div_ceil(2),
            least_area: 0.25 * self.least_area,
        })
    }
}
