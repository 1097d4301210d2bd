//! Half-edges of a triangle mesh, sorted by edge.

/// One side of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct HalfEdge {
    /// Both vertices, the lower first.
    pub(crate) edge: (u32, u32),
    /// True if the half-edge runs from the lower to the higher vertex.
    pub(crate) forward: bool,
    /// `3 f + k` for the side of triangle `f` that runs from corner `k` to corner `k + 1`.
    pub(crate) index: u32,
}

impl HalfEdge {
    /// The triangle of the half-edge.
    pub(crate) fn face(&self) -> u32 {
        self.index / 3
    }
}

/// All half-edges of a mesh by edge, then by direction, backward first, then by index; so those of one edge are next to
/// each other.
pub(crate) fn sorted_half_edges(triangles: &[[u32; 3]]) -> Vec<HalfEdge> {
    let mut out = Vec::with_capacity(triangles.len() * 3);
    for (t, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            out.push(HalfEdge { edge: (a.min(b), a.max(b)), forward: a < b, index: (3 * t + k) as u32 });
        }
    }
    out.sort_unstable();
    out
}
