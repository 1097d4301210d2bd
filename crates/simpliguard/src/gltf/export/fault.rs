//! Errors that point at simpliguard itself.

use crate::{Error, StageId};

/// The error for a broken level or document: a fault of an earlier stage, not of the file.
pub(in crate::gltf) fn fault(asset: &str, found: impl Into<String>) -> Error {
    Error::invalid(asset, StageId::Export, found, "this is a fault of simpliguard: please report it with the model")
}
