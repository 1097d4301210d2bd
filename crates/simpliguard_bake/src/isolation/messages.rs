//! What a child tells its parent while it bakes: lines of its standard output.

use std::io::{self, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use simpliguard::{Error, Progress, Report, StageId};

use crate::result::BakeResult;

/// The first characters of each line that is a message. A program may print other lines before it serves.
const PREFIX: &str = "simpliguard-child ";

/// Set in the environment of a child.
pub(super) const CHILD_VAR: &str = "SIMPLIGUARD_CHILD";

/// A message of a child.
#[derive(Serialize, Deserialize)]
pub(super) enum Message {
    /// The child waits for its request.
    Ready,
    /// See [`Progress`].
    Progress { stage: StageId, level: Option<usize>, fraction: f32 },
    /// An object of a scene has its levels.
    Object { name: String, is_cached: bool },
    /// A line for the log.
    Notice { text: String, is_warning: bool },
    /// Levels that can be shown while better ones are made are in this file.
    Preview(String),
    /// The bake is done, and its parts are in files.
    Done(Box<Parts>),
    /// The bake failed.
    Failed(Error),
}

/// A result whose bytes are in files of the folder.
#[derive(Serialize, Deserialize)]
pub(super) struct Parts {
    combined: String,
    levels: Vec<(u32, String)>,
    sheet: Option<String>,
    report: Report,
}

impl Message {
    /// Sends the message as one line.
    pub(super) fn send(&self) -> io::Result<()> {
        let mut out = io::stdout().lock();
        // What the program has printed may lack the end of its line.
        writeln!(out, "\n{PREFIX}{}", serde_json::to_string(self)?)?;
        out.flush()
    }

    /// The message in a line; `None` for a line of the program.
    pub(super) fn parse(line: &str) -> Option<Self> {
        serde_json::from_str(line.strip_prefix(PREFIX)?).ok()
    }
}

impl From<Progress> for Message {
    fn from(Progress { stage, level, fraction }: Progress) -> Self {
        Self::Progress { stage, level, fraction }
    }
}

impl Parts {
    /// Writes the bytes of a result to files.
    pub(super) fn write(result: &BakeResult, folder: &Path) -> io::Result<Self> {
        let write = |name: String, bytes: &[u8]| std::fs::write(folder.join(&name), bytes).map(|()| name);
        let level = |(budget, glb): &(u32, Vec<u8>)| Ok((*budget, write(format!("level_{budget}.glb"), glb)?));
        Ok(Self {
            combined: write("combined.glb".to_owned(), &result.combined)?,
            levels: result.levels.iter().map(level).collect::<io::Result<_>>()?,
            sheet: result.sheet.as_ref().map(|png| write("sheet.png".to_owned(), png)).transpose()?,
            report: result.report.clone(),
        })
    }

    /// Reads what [`Self::write`] has written.
    pub(super) fn read(self, folder: &Path) -> io::Result<BakeResult> {
        let read = |name: &str| std::fs::read(folder.join(name));
        let level = |(budget, name): &(u32, String)| Ok((*budget, read(name)?));
        Ok(BakeResult {
            combined: read(&self.combined)?,
            levels: self.levels.iter().map(level).collect::<io::Result<_>>()?,
            sheet: self.sheet.as_deref().map(read).transpose()?,
            report: self.report,
        })
    }
}
