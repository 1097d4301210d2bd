//! `KHR_draco_mesh_compression`.
//!
//! The `draco-core` crate decodes the primitives. Decoded vertices and indices then stand in ordinary buffer views, and
//! the extension leaves the JSON, so that the rest of the import and the export see an ordinary glTF. A primitive that
//! has plain data beside the compressed one, in a file that does not require the extension, is left as it is. Morph
//! targets are not compressed: their accessors stay.

mod decode;
mod geometry;
mod replace;

pub(super) use self::decode::{decode, is_required};
pub(super) use self::replace::replace;
