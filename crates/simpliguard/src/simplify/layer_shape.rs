//! The shape of a layer beside the solid one.

use crate::data::{Cards, Parts, TriMesh};

/// The mesh of a layer beside the solid one: a clear surface, or lattices.
#[derive(Clone, Debug)]
pub struct LayerShape {
    /// World space.
    pub mesh: TriMesh,
    /// Back faces are visible.
    pub double_sided: bool,
    /// Faces that are cut-out cards, if the layer consists of lattices.
    pub cards: Option<Cards>,
    /// Parts of a clear surface that the faces show.
    pub parts: Option<Parts>,
}
