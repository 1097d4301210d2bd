//! `simpliguard farm submit --slurm`: the tasks of a bundle as job arrays.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use simpliguard_cache::{Durability, write_atomic};

use super::args::SubmitArgs;
use super::bundle::SLURM;
use super::manifest::Manifest;
use super::worker::{Places, arguments};
use crate::Exit;
use crate::console;
use crate::error::UsageError;
use crate::output::write_stdout;

/// The variable with the number of tasks before those of an array.
const OFFSET: &str = "SIMPLIGUARD_FIRST_TASK";

/// Carries the command out. Prints the ids of the arrays, one a line; with `--dry-run`, the commands.
pub(super) fn run(args: &SubmitArgs) -> Result<Exit, UsageError> {
    let manifest = Manifest::read(&args.bundle)?;
    if manifest.tasks.is_empty() {
        console::line("nothing to bake: the plan has no tasks");
        return Ok(Exit::Done);
    }
    let failed = |e| UsageError(format!("--bundle {}: cannot write the script: {e}", args.bundle.display()));
    let bundle = args.bundle.canonicalize().map_err(failed)?;
    let script = script(&manifest, &bundle, &program(args)?);
    write_atomic(&bundle.join(SLURM), script.as_bytes(), Durability::Process).map_err(failed)?;
    fs::create_dir_all(bundle.join("logs")).map_err(failed)?;
    let mut printed = String::new();
    for arguments in arrays(manifest.tasks.len(), &bundle, args) {
        if args.dry_run {
            let words: Vec<String> = arguments.iter().map(|argument| quote(argument)).collect();
            printed += &format!("sbatch {}\n", words.join(" "));
        } else {
            printed += &submit(&arguments)?;
        }
    }
    write_stdout(&printed)?;
    Ok(Exit::Done)
}

/// The program on the workers.
fn program(args: &SubmitArgs) -> Result<PathBuf, UsageError> {
    let program = args.command.clone().map_or_else(std::env::current_exe, Ok);
    program.map_err(|e| UsageError(format!("cannot find this program: {e}; give --command")))
}

/// The arguments of `sbatch` for each array. An array has a limited size, so a job may be several arrays.
fn arrays(tasks: usize, bundle: &Path, args: &SubmitArgs) -> Vec<Vec<String>> {
    let size = args.array_size.get();
    let array = |first: usize| {
        let last = size.min(tasks - first);
        let own = [
            "--parsable".to_owned(),
            format!("--array=1-{last}"),
            format!("--export=ALL,{OFFSET}={first}"),
            format!("--output={}/logs/%A_%a.log", bundle.display()),
        ];
        own.into_iter().chain(args.sbatch.iter().cloned()).chain([bundle.join(SLURM).display().to_string()]).collect()
    };
    (0..tasks).step_by(size).map(array).collect()
}

fn submit(arguments: &[String]) -> Result<String, UsageError> {
    let output = Command::new("sbatch").args(arguments).stdin(Stdio::null()).output();
    let output = output.map_err(|e| UsageError(format!("cannot run sbatch: {e}; submit on a machine with Slurm")))?;
    if !output.status.success() {
        let found = String::from_utf8_lossy(&output.stderr);
        return Err(UsageError(format!("sbatch refused the job: {}", found.trim())));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The script of a task. It needs a POSIX shell.
fn script(manifest: &Manifest, bundle: &Path, program: &Path) -> String {
    let text = |text: &Option<String>| quote(text.as_deref().unwrap_or_default());
    let bundle_text = quote(&bundle.display().to_string());
    let places = Places {
        assets: quote(&manifest.assets),
        project: text(&manifest.project),
        cache_dir: text(&manifest.cache_dir),
        shared_cache: text(&manifest.shared_cache),
        settings: "\"$bundle\"/settings.ron".to_owned(),
        list: "\"$bundle\"/tasks/\"$task\".txt".to_owned(),
        report: "\"$bundle\"/reports/\"$task\".json".to_owned(),
        output: "\"$output\"".to_owned(),
    };
    let arguments = arguments(manifest, &places, quote).join(" ");
    let program = quote(&program.display().to_string());
    let (cpus, memory) = (manifest.worker.cpus, manifest.worker.memory);
    format!(
        "#!/bin/sh\n\
         #SBATCH --job-name=simpliguard\n\
         #SBATCH --cpus-per-task={cpus}\n\
         #SBATCH --mem={memory}M\n\
         #SBATCH --requeue\n\
         set -eu\n\
         bundle={bundle_text}\n\
         task=$((SLURM_ARRAY_TASK_ID + {OFFSET}))\n\
         output=$(mktemp -d)\n\
         trap 'rm -rf \"$output\"' EXIT\n\
         {program} {arguments} --threads {cpus} --memory {}MiB\n",
        memory / 2
    )
}

/// A text as one word of a POSIX shell.
fn quote(text: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./=:,%+".contains(&byte);
    if !text.is_empty() && text.bytes().all(is_plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_shell_are_one_word_each() {
        assert_eq!(quote("s3://levels/a"), "s3://levels/a");
        assert_eq!(quote(""), "''");
        assert_eq!(quote("it's $HOME"), "'it'\\''s $HOME'");
    }
}
