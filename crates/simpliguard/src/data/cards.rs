//! Cut-out cards in place of foliage.

/// Group of faces that are no card, and of triangles that are no leaf.
pub const NO_CARD: u32 = u32::MAX;

/// Which faces of a level are cards, and what each one shows.
#[derive(Clone, Debug, Default)]
pub struct Cards {
    /// Group of each face of the level, or [`NO_CARD`].
    pub group: Vec<u32>,
    /// Group of each triangle of the source, or [`NO_CARD`].
    pub source_group: Vec<u32>,
    /// Half the extent of each group along its card's normal.
    pub reach: Vec<f32>,
}
