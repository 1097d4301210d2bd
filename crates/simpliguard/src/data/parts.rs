//! Parts of a source that faces of a level show.

/// The part of the source that each face of a level shows. Walls of clear surfaces lie close to each other, or in one place:
/// the nearest point alone does not tell which of them a face stands for.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// Part of each face of the level.
    pub of_faces: Vec<u32>,
    /// Part of each triangle of the source, or [`NO_PART`].
    pub of_source: Vec<u32>,
}

/// Part of a triangle that no face shows.
pub const NO_PART: u32 = u32::MAX;
