//! `simpliguard inspect`: how the program bakes.

use serde::Serialize;
use simpliguard::{PIPELINE_VERSION, STAGES, Stage};

use crate::args::InspectArgs;
use crate::error::UsageError;
use crate::output::{columns, json_text, write_stdout};

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

#[derive(Serialize)]
struct Document {
    version: u32,
    pipeline_version: &'static str,
    stages: &'static [Stage],
}

pub(crate) fn run(args: &InspectArgs) -> Result<(), UsageError> {
    // So far there is nothing else to inspect.
    debug_assert!(args.pipeline, "clap requires the flag");
    let text = if args.json {
        let (version, pipeline_version, stages) = (DOCUMENT_VERSION, PIPELINE_VERSION, &STAGES[..]);
        json_text(&Document { version, pipeline_version, stages })?
    } else {
        stage_table()
    };
    write_stdout(&text)
}

/// The stages in the order in which they run.
fn stage_table() -> String {
    let header = ["stage", "version", "weight", "runs", "purpose"].map(str::to_owned).to_vec();
    let row = |stage: &Stage| {
        let runs = if stage.per_level { "for each level" } else { "once" };
        let (weight, purpose) = (format!("{} %", stage.weight), stage.purpose.to_owned());
        vec![stage.id.to_string(), stage.version.to_string(), weight, runs.to_owned(), purpose]
    };
    let rows: Vec<_> = std::iter::once(header).chain(STAGES.iter().map(row)).collect();
    columns(&rows, 1, true)
}
