//! The file of a bake.

use super::params::Params;
use super::runner::Runner;
use super::version::PIPELINE_VERSION;
use crate::data::{Level, Model};
use crate::gltf::{self, ExportParams};
use crate::{Error, StageId};

/// The source and its levels as one binary glTF.
pub(super) fn export(model: &Model, levels: &[Level], params: &Params, run: &Runner<'_>) -> Result<Vec<u8>, Error> {
    run.run(StageId::Export, || gltf::export_in(model, levels, &params.export, PIPELINE_VERSION, run.cancellation()))?
}

/// A source in pieces as one binary glTF, without levels.
pub(super) fn pack(model: &Model) -> Result<Vec<u8>, Error> {
    gltf::export(model, &[], &ExportParams::default())
}
