//! The stages of the pipeline in the order in which they run.

use serde::Serialize;
use simpliguard::{PIPELINE_VERSION, STAGES, Stage};

use super::DOCUMENT_VERSION;
use crate::error::UsageError;
use crate::output::{columns, json_text};

#[derive(Serialize)]
struct Document {
    version: u32,
    pipeline_version: &'static str,
    stages: &'static [Stage],
}

pub(super) fn text(json: bool) -> Result<String, UsageError> {
    if json {
        let (version, pipeline_version, stages) = (DOCUMENT_VERSION, PIPELINE_VERSION, &STAGES[..]);
        return json_text(&Document { version, pipeline_version, stages });
    }
    let header = ["stage", "version", "weight", "runs", "purpose"].map(str::to_owned).to_vec();
    let row = |stage: &Stage| {
        let runs = if stage.per_level { "for each level" } else { "once" };
        let (weight, purpose) = (format!("{} %", stage.weight), stage.purpose.to_owned());
        vec![stage.id.to_string(), stage.version.to_string(), weight, runs.to_owned(), purpose]
    };
    let rows: Vec<_> = std::iter::once(header).chain(STAGES.iter().map(row)).collect();
    Ok(columns(&rows, 1, true))
}
