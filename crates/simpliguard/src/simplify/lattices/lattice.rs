//! Lattices.

/// A flat part of a surface with many bars.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// Its triangles, ascending.
    pub triangles: Vec<u32>,
    /// The number of its bars, or of its holes.
    pub bars: u32,
}
