//! `simpliguard farm run --local`: the tasks of a bundle here, by `openjd run`.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;

use super::args::RunArgs;
use super::bundle::TEMPLATE;
use super::manifest::Manifest;
use super::status;
use super::template::{STEP, TASK, values};
use crate::Exit;
use crate::console;
use crate::error::UsageError;

/// Carries the command out. A task that fails does not stop the others; the report says what is missing.
pub(super) fn run(args: &RunArgs) -> Result<Exit, UsageError> {
    let manifest = Manifest::read(&args.bundle)?;
    if !manifest.tasks.is_empty() {
        check_openjd(&args.openjd)?;
        run_tasks(&manifest, args)?;
    }
    status::report(&manifest, &args.bundle, args.json)
}

fn check_openjd(program: &Path) -> Result<(), UsageError> {
    let ran = Command::new(program).arg("--version").stdin(Stdio::null()).output();
    let found = match ran {
        Ok(output) if output.status.success() => return Ok(()),
        Ok(output) => output.status.to_string(),
        Err(e) => e.to_string(),
    };
    Err(UsageError(format!(
        "cannot run {}: {found}; install it with `pip install openjd-cli`, or give its path with --openjd",
        program.display()
    )))
}

fn run_tasks(manifest: &Manifest, args: &RunArgs) -> Result<(), UsageError> {
    let logs = args.bundle.join("logs");
    fs::create_dir_all(&logs).map_err(|e| UsageError(format!("{}: cannot make the folder: {e}", logs.display())))?;
    let program = std::env::current_exe().map_err(|e| UsageError(format!("cannot find this program: {e}")))?;
    let arguments = job_arguments(manifest, &args.bundle, &program);
    let (next, errors, total) = (AtomicUsize::new(1), Mutex::new(Vec::new()), manifest.tasks.len());
    let work = || {
        loop {
            let task = next.fetch_add(1, Relaxed);
            if task > total {
                return;
            }
            match run_task(args, &arguments, task) {
                Ok(outcome) => console::line(&format!("[{task}/{total}] {outcome}")),
                Err(e) => errors.lock().unwrap_or_else(PoisonError::into_inner).push(e),
            }
        }
    };
    thread::scope(|scope| (0..args.jobs.get().min(total)).for_each(|_| drop(scope.spawn(work))));
    match errors.into_inner().unwrap_or_else(PoisonError::into_inner).pop() {
        Some(e) => Err(UsageError(format!("cannot run {}: {e}; see {}", args.openjd.display(), logs.display()))),
        None => Ok(()),
    }
}

/// The arguments of `openjd` for every task.
fn job_arguments(manifest: &Manifest, bundle: &Path, program: &Path) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec!["run".into(), bundle.join(TEMPLATE).into()];
    arguments.extend(["--step".into(), STEP.into()]);
    let mut command = OsString::from("Command=");
    command.push(program);
    let values = values(manifest).into_iter().map(|(name, value)| format!("{name}={value}").into());
    for value in [command].into_iter().chain(values) {
        arguments.extend(["--job-param".into(), value]);
    }
    arguments
}

/// Runs one task. Its output goes to a log in the bundle.
fn run_task(args: &RunArgs, arguments: &[OsString], task: usize) -> io::Result<String> {
    let log = args.bundle.join("logs").join(format!("{task}.log"));
    let file = File::create(&log)?;
    let mut command = Command::new(&args.openjd);
    command.args(arguments).args(["--task-param".to_owned(), format!("{TASK}={task}")]);
    let status = command.stdin(Stdio::null()).stdout(file.try_clone()?).stderr(file).status()?;
    Ok(if status.success() { "done".to_owned() } else { format!("failed ({status}); see {}", log.display()) })
}
