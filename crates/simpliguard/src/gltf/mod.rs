//! glTF in and out.

mod uris;

pub use uris::external_uris;
