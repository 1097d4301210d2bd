//! The candidates for a level's shape.

use super::TriMesh;

/// The method that made a shape.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Candidate {
    /// A reconstruction at this resolution.
    Reconstruction(Reconstruction),
    /// The source's own triangles.
    Source,
    /// Cut-out cards in place of leaves; the rest is simplified.
    Cards,
}

impl std::fmt::Display for Candidate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Reconstruction(p) => write!(f, "reconstruction {} (offset {})", p.resolution, p.offset),
            Self::Source => f.write_str("source"),
            Self::Cards => f.write_str("cards"),
        }
    }
}

/// Parameters of a reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Reconstruction {
    /// Cells along the longest side, a multiple of 8, at least 32.
    pub resolution: u32,
    /// Distance of the surface from the source, in cells, before it is pulled back; above 0.5.
    pub offset: f32,
    /// Fraction of that distance that stays after the pull, where two sides of the surface must stay apart; 0 to 1.
    pub keep: f32,
}

impl Reconstruction {
    /// Number of empty samples around the source on every side.
    pub(crate) const MARGIN: f32 = 6.0;

    /// The usual offset and pull at a resolution.
    pub fn new(resolution: u32) -> Self {
        Self { resolution: resolution.next_multiple_of(8).max(32), offset: 0.55, keep: 0.2 }
    }

    /// An offset so large that parts of the source which lie close together merge: few handles.
    pub fn thick(resolution: u32) -> Self {
        Self { offset: 1.5, ..Self::new(resolution) }
    }

    /// Side of a cell in metres, for a mesh without unused vertices.
    pub fn cell(&self, mesh: &TriMesh) -> f32 {
        let (low, high) = mesh.bounds();
        self.spacing((high - low).max_element())
    }

    /// The resolution at which `part`, a part of `whole`, has cells of about the same size, and none larger.
    pub fn resolution_for(&self, whole: &TriMesh, part: &TriMesh) -> u32 {
        let (low, high) = part.bounds();
        let cells = ((high - low).max_element() / self.cell(whole) + 2.0 * Self::MARGIN).ceil() as u32;
        cells.next_multiple_of(8).clamp(32, self.resolution)
    }

    /// Distance between samples, in metres, for a source whose longest side is `extent` metres.
    pub(crate) fn spacing(&self, extent: f32) -> f32 {
        extent.max(f32::MIN_POSITIVE * 1e6) / (self.resolution as f32 - 2.0 * Self::MARGIN)
    }
}
