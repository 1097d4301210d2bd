//! The context of an import: the file's name for messages, its limits, and the flag that stops it.

use serde::Deserialize;
use serde_json::Value;

use super::limits::ImportLimits;
use super::memory::Memory;
use super::schema::Root;
use crate::{Cancellation, Error, StageId};

const ADVICE: &str = "check it with glTF-Validator and export it again";

#[derive(Clone, Copy)]
pub(super) struct Asset<'a> {
    pub(super) name: &'a str,
    pub(super) limits: &'a ImportLimits,
    pub(super) cancellation: &'a Cancellation,
    pub(super) memory: &'a Memory,
}

impl Asset<'_> {
    /// The error for a file that breaks a rule of glTF.
    pub(super) fn invalid(&self, found: impl Into<String>) -> Error {
        Error::invalid(self.name, StageId::Import, found, ADVICE)
    }

    /// The error for a file of another type.
    pub(super) fn not_gltf(&self, why: &str) -> Error {
        let advice = "give a .glb or .gltf file, or convert this one";
        Error::invalid(self.name, StageId::Import, format!("not a glTF file: {why}"), advice)
    }

    /// `Err` once the bake is cancelled.
    pub(super) fn check(&self) -> Result<(), Error> {
        self.cancellation.check(self.name)
    }

    /// `Err` if `found` is over `limit`; `what` names the quantity and its unit.
    pub(super) fn within(&self, what: &str, found: usize, limit: u64) -> Result<(), Error> {
        let found = found as u64;
        if found <= limit {
            return Ok(());
        }
        Err(Error::Limit { asset: self.name.to_owned(), stage: StageId::Import, what: what.to_owned(), found, limit })
    }

    /// Counts `bytes` that are about to be allocated; `what` names their use. `Err` if they are over the memory that is
    /// left.
    pub(super) fn allocate(&self, what: &str, bytes: u64) -> Result<(), Error> {
        if self.memory.take(bytes) { Ok(()) } else { Err(self.too_large(what, bytes)) }
    }

    /// As [`Self::allocate`], for memory that is free again soon.
    pub(super) fn fits(&self, what: &str, bytes: u64) -> Result<(), Error> {
        if self.memory.has(bytes) { Ok(()) } else { Err(self.too_large(what, bytes)) }
    }

    fn too_large(&self, what: &str, needed: u64) -> Error {
        let (asset, what, limit) = (self.name.to_owned(), what.to_owned(), self.memory.limit());
        Error::Memory { asset, stage: StageId::Import, what, needed, limit }
    }

    /// Reads the schema. The message of an error names the JSON path that breaks it.
    pub(super) fn schema<'j>(&self, json: &'j Value) -> Result<Root<'j>, Error> {
        let mut track = serde_path_to_error::Track::new();
        Root::deserialize(serde_path_to_error::Deserializer::new(json, &mut track))
            .map_err(|error| self.invalid(format!("its JSON breaks the schema at '{}': {error}", track.path())))
    }

    /// Item `index` of a top-level list; `name` is the list's name in the message of an error.
    pub(super) fn item<'l, T>(&self, list: &'l [T], index: usize, name: &str) -> Result<&'l T, Error> {
        list.get(index).ok_or_else(|| {
            self.invalid(format!("it refers to {name} {index}, counted from 0, but has {} of them", list.len()))
        })
    }
}

/// Notes for the report: each count above zero with its text.
pub(super) fn counted(counts: &[(usize, &str)]) -> Vec<String> {
    counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect()
}
