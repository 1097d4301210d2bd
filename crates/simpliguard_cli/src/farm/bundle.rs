//! The files of a bundle.
//!
//! ```text
//! plan.json               the manifest: all models, their keys, their tasks
//! template.yaml           the job template of Open Job Description
//! parameter_values.yaml   values of its parameters, as AWS Deadline Cloud reads them
//! asset_references.yaml   the files that the tasks read, for farms that copy them to the workers
//! settings.ron            the settings file of the command line, if there was one
//! tasks/1.txt             the models of the first task
//! reports/1.json          the report of the first task, written by its worker
//! ```

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::json;
use simpliguard_cache::{Durability, write_atomic};

use super::manifest::{MANIFEST, Manifest, list_path};
use super::template;
use crate::error::UsageError;
use crate::output::json_text;

/// The job template in a bundle.
pub(super) const TEMPLATE: &str = "template.yaml";
const VALUES: &str = "parameter_values.yaml";
const REFERENCES: &str = "asset_references.yaml";
const SETTINGS: &str = "settings.ron";
/// The script for Slurm.
pub(super) const SLURM: &str = "slurm.sh";
/// Folders whose files are named by the number of a task.
const NUMBERED: [&str; 3] = ["tasks", "reports", "logs"];

/// Everything that a bundle holds.
pub(super) struct Bundle<'a> {
    pub(super) manifest: &'a Manifest,
    /// The models of each task, relative to the folder of the models.
    pub(super) lists: &'a [Vec<String>],
    /// The files that the tasks read.
    pub(super) files: &'a [PathBuf],
    /// The text of the settings file of the command line.
    pub(super) settings: Option<&'a str>,
}

/// Checks that a folder is missing or empty, or holds a bundle that may be replaced.
pub(super) fn check(folder: &Path) -> Result<(), UsageError> {
    let failed = |found: String| UsageError(format!("--bundle {}: {found}", folder.display()));
    match fs::read_dir(folder).map(|mut entries| entries.next().is_none()) {
        Ok(is_empty) if is_empty || folder.join(MANIFEST).is_file() => Ok(()),
        Ok(_) => Err(failed("the folder holds other files; choose a new or empty one".into())),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(failed(format!("cannot read the folder: {e}"))),
    }
}

impl Bundle<'_> {
    /// Writes the bundle in place of a former one. Without tasks it is only the manifest: there is no job to submit.
    pub(super) fn write(&self, folder: &Path) -> Result<(), UsageError> {
        let failed = |e: io::Error| {
            UsageError(format!(
                "--bundle {}: cannot write it: {e}; check the folder and the space on its disk",
                folder.display()
            ))
        };
        remove_former(folder).map_err(failed)?;
        let write = |name: &Path, text: &str| write_atomic(&folder.join(name), text.as_bytes(), Durability::Process);
        for (task, list) in self.lists.iter().enumerate() {
            write_atomic(&list_path(folder, task + 1), lines(list).as_bytes(), Durability::Process).map_err(failed)?;
        }
        if !self.lists.is_empty() {
            if let Some(settings) = self.settings {
                write(Path::new(SETTINGS), settings).map_err(failed)?;
            }
            fs::create_dir_all(folder.join("reports")).map_err(failed)?;
            for (name, text) in self.documents()? {
                write(Path::new(name), &text).map_err(failed)?;
            }
        }
        // Last: a bundle without its manifest is no bundle.
        write(Path::new(MANIFEST), &json_text(self.manifest)?).map_err(failed)
    }

    fn documents(&self) -> Result<[(&'static str, String); 3], UsageError> {
        #[derive(Serialize)]
        struct Value<'a> {
            name: &'a str,
            value: &'a str,
        }
        let values = template::values(self.manifest).into_iter().map(|(name, value)| Value { name, value });
        let files: Vec<_> = self.files.iter().map(|path| path.to_string_lossy()).collect();
        Ok([
            (TEMPLATE, json_text(&template::template(self.manifest))?),
            (VALUES, json_text(&json!({"parameterValues": values.collect::<Vec<_>>()}))?),
            (REFERENCES, json_text(&json!({"assetReferences": {"inputs": {"filenames": files}}}))?),
        ])
    }
}

fn lines(list: &[String]) -> String {
    list.iter().flat_map(|line| [line.as_str(), "\n"]).collect()
}

/// Removes the files of a former bundle, and nothing else.
fn remove_former(folder: &Path) -> io::Result<()> {
    for name in [MANIFEST, TEMPLATE, VALUES, REFERENCES, SETTINGS, SLURM] {
        remove(&folder.join(name))?;
    }
    for name in NUMBERED {
        let Ok(entries) = fs::read_dir(folder.join(name)) else { continue };
        for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
            let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
            if !stem.is_empty() && stem.bytes().all(|byte| byte.is_ascii_digit()) {
                remove(&path)?;
            }
        }
    }
    Ok(())
}

fn remove(file: &Path) -> io::Result<()> {
    match fs::remove_file(file) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}
