//! Cut-out cards in place of foliage.

/// Group of a face that is no card, and of a triangle that is no leaf.
pub const NO_CARD: u32 = u32::MAX;

/// The cards of a level, and the leaves that each card shows.
#[derive(Clone, Debug, Default)]
pub struct Cards {
    /// Group of each face of the level, or [`NO_CARD`].
    pub group: Vec<u32>,
    /// Group of each triangle of the source, or [`NO_CARD`].
    pub source_group: Vec<u32>,
    /// Half the extent of each group along its card's normal, in metres.
    pub reach: Vec<f32>,
}
