//! The ways to a shape.

use super::TriMesh;

/// Where a shape came from.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Candidate {
    /// A reconstruction at this resolution.
    Reconstruction(Reconstruction),
    /// The source's own triangles.
    Source,
    /// Cut-out cards for the leaves, the rest collapsed.
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

/// How to reconstruct.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Reconstruction {
    /// Cells along the longest side, a multiple of 8, at least 32.
    pub resolution: u32,
    /// Distance of the surface from the source in cells before it is pulled back; above 0.5.
    pub offset: f32,
    /// Part of the distance to the source that is kept after the pull, where its sides must stay apart.
    pub keep: f32,
}

impl Reconstruction {
    /// Empty samples around the source on every side.
    pub(crate) const MARGIN: f32 = 6.0;

    /// The usual offset and pull at a resolution.
    pub fn new(resolution: u32) -> Self {
        Self { resolution: resolution.next_multiple_of(8).max(32), offset: 0.55, keep: 0.2 }
    }

    /// Far enough from the source that parts which lie close together grow into one: few handles.
    pub fn thick(resolution: u32) -> Self {
        Self { offset: 1.5, ..Self::new(resolution) }
    }

    /// Side of a cell in metres, for a mesh all of whose vertices are in use.
    pub fn cell(&self, mesh: &TriMesh) -> f32 {
        let (low, high) = mesh.bounds();
        self.spacing((high - low).max_element())
    }

    /// The resolution at which a part of `whole` has cells of about the same size, none larger.
    pub fn resolution_for(&self, whole: &TriMesh, part: &TriMesh) -> u32 {
        let (low, high) = part.bounds();
        let cells = ((high - low).max_element() / self.cell(whole) + 2.0 * Self::MARGIN).ceil() as u32;
        cells.next_multiple_of(8).clamp(32, self.resolution)
    }

    /// Distance between samples for a source whose longest side is `extent`.
    pub(crate) fn spacing(&self, extent: f32) -> f32 {
        extent.max(f32::MIN_POSITIVE * 1e6) / (self.resolution as f32 - 2.0 * Self::MARGIN)
    }
}
