//! A game's folder with the game running in a process of its own.

use std::cell::Cell;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use super::app;

/// Far more than anything takes, on a machine that does other things as well.
pub(super) const PATIENCE: Duration = Duration::from_secs(120);

/// Settings with which a bake takes a fraction of a second.
const QUICK: &str = "(defaults: (faces: [100, 200], quality: Draft, candidates: Source, views: 8, view_size: 128, \
                     texture_size: 64, normal_map: false))";

/// A folder with `assets/`, `config/` and a cache.
pub(super) struct Project {
    dir: TempDir,
    cache: PathBuf,
}

impl Project {
    pub(super) fn new() -> Self {
        let dir = tempfile::tempdir().expect("tempdir");
        let project = Self { cache: dir.path().join("cache"), dir };
        project.save("config/simpliguard.ron", QUICK);
        fs::create_dir(project.path("assets")).expect("makes a folder");
        project
    }

    /// As [`Self::new`], with the cache elsewhere.
    pub(super) fn with_cache(cache: &Path) -> Self {
        Self { cache: cache.to_owned(), ..Self::new() }
    }

    pub(super) fn path(&self, below: &str) -> PathBuf {
        self.dir.path().join(below)
    }

    /// Writes a file as an editor does.
    pub(super) fn save(&self, below: &str, content: impl AsRef<[u8]>) {
        let path = self.path(below);
        fs::create_dir_all(path.parent().expect("it is below a folder")).expect("makes a folder");
        fs::write(path, content).expect("writes");
    }

    /// Starts the game, which loads every model in `assets/`.
    pub(super) fn run(&self) -> Game {
        self.run_with("")
    }

    /// Starts the game with options of [`app::Options`], as RON without the parentheses.
    pub(super) fn run_with(&self, options: &str) -> Game {
        self.run_command(Command::new(std::env::current_exe().expect("known")), options)
    }

    /// As [`Self::run_with`] on a disk on which no file can have more than `kib` KiB.
    #[cfg(unix)]
    pub(super) fn run_on_full_disk(&self, kib: u64) -> Game {
        let mut shell = Command::new("sh");
        // Blocks of 512 bytes; a write beyond fails once the signal is ignored.
        shell.args(["-c", &format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", 2 * kib)]);
        shell.arg(std::env::current_exe().expect("known"));
        self.run_command(shell, "")
    }

    fn run_command(&self, mut command: Command, options: &str) -> Game {
        let mut child = command
            .args(["--exact", app::NAME, "--ignored", "--nocapture", "--test-threads=1"])
            .env("BEVY_ASSET_ROOT", self.dir.path())
            .env("SIMPLIGUARD_CACHE_DIR", &self.cache)
            .env(app::OPTIONS, format!("({options})"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let (lines, log) = (lines_of(child.stdout.take()), lines_of(child.stderr.take()));
        Game { child, lines, log, past: Vec::new(), logged: Vec::new() }
    }
}

fn lines_of(stream: Option<impl std::io::Read + Send + 'static>) -> Receiver<String> {
    let (sender, receiver) = channel();
    let stream = BufReader::new(stream.expect("it is piped"));
    thread::spawn(move || stream.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
    receiver
}

/// The running game, and what it has reported.
pub(super) struct Game {
    child: Child,
    lines: Receiver<String>,
    log: Receiver<String>,
    past: Vec<Value>,
    logged: Vec<String>,
}

impl Game {
    /// Waits for the next report for which `wanted` holds.
    #[track_caller]
    pub(super) fn wait(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(line) => {
                    let Some(report) = line.strip_prefix(app::REPORT) else { continue };
                    let report: Value = serde_json::from_str(report).expect("JSON");
                    self.past.push(report.clone());
                    if wanted(&report) {
                        return report;
                    }
                }
                Err(RecvTimeoutError::Timeout) => panic!("{what} never came\n{}", self.story()),
                Err(RecvTimeoutError::Disconnected) => panic!("the game ended before {what}\n{}", self.story()),
            }
        }
    }

    /// Waits until the game shows a model with so many levels; 0 is the model alone.
    #[track_caller]
    pub(super) fn wait_for_levels(&mut self, path: &str, levels: u64) -> Value {
        let what = format!("{path} with {levels} levels");
        self.wait(&what, |r| r["what"] == "loaded" && r["path"] == path && r["levels"] == levels)
    }

    /// Waits for a message about a model, such as `started`.
    #[track_caller]
    pub(super) fn wait_for(&mut self, what: &str, path: &str) -> Value {
        self.wait(&format!("{what} of {path}"), |r| r["what"] == what && r["path"] == path)
    }

    /// Waits until a model fails with an error that starts like `error`, and is shown with so many levels, in any order.
    #[track_caller]
    pub(super) fn wait_for_failure_and_levels(&mut self, path: &str, error: &str, levels: u64) {
        let is_error = |r: &Value| r["error"].as_str().is_some_and(|text| text.starts_with(error));
        self.wait_for_levels_and(path, levels, |r| r["what"] == "failed" && is_error(r));
    }

    /// Waits until a bake of a model starts, and it is shown with so many levels, in any order.
    #[track_caller]
    pub(super) fn wait_for_start_and_levels(&mut self, path: &str, levels: u64) {
        self.wait_for_levels_and(path, levels, |r| r["what"] == "started");
    }

    #[track_caller]
    fn wait_for_levels_and(&mut self, path: &str, levels: u64, wanted: impl Fn(&Value) -> bool) {
        let (met, shown) = (Cell::new(false), Cell::new(false));
        self.wait("a report and levels", |r| {
            met.set(met.get() || wanted(r) && r["path"] == path);
            shown.set(shown.get() || r["what"] == "loaded" && r["path"] == path && r["levels"] == levels);
            met.get() && shown.get()
        });
    }

    /// As [`Self::wait_for`] for several models, in any order.
    #[track_caller]
    pub(super) fn wait_for_each(&mut self, what: &str, paths: &[&str]) {
        let mut left: Vec<&str> = paths.to_vec();
        while !left.is_empty() {
            let report = self.wait(&format!("{what} of {left:?}"), |r| r["what"] == what);
            left.retain(|path| report["path"] != *path);
        }
    }

    /// Waits for a line of the log that holds `text`.
    #[track_caller]
    pub(super) fn wait_for_log(&mut self, text: &str) {
        let end = Instant::now() + PATIENCE;
        while !self.logged.iter().any(|line| line.contains(text)) {
            match self.log.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(line) => self.logged.push(line),
                Err(_) => panic!("'{text}' was never logged\n{}", self.story()),
            }
        }
    }

    /// Takes in what is reported for a while.
    pub(super) fn listen(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while let Ok(line) = self.lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
            if let Some(report) = line.strip_prefix(app::REPORT) {
                self.past.push(serde_json::from_str(report).expect("JSON"));
            }
        }
    }

    /// A number from the system's table of processes, such as `VmHWM`, the most memory the game ever had, in KiB.
    #[cfg(target_os = "linux")]
    pub(super) fn proc_status(&self, field: &str) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).expect("reads");
        let value = status.lines().find_map(|line| line.strip_prefix(field)?.strip_prefix(':'));
        value.and_then(|v| v.split_whitespace().next()?.parse().ok()).expect("a number")
    }

    /// How many threads there are whose names start so.
    #[cfg(target_os = "linux")]
    pub(super) fn threads(&self, start: &str) -> usize {
        let threads = fs::read_dir(format!("/proc/{}/task", self.child.id())).expect("lists").filter_map(Result::ok);
        let names = threads.filter_map(|thread| fs::read_to_string(thread.path().join("comm")).ok());
        names.filter(|name| name.starts_with(start)).count()
    }

    /// The latest report of a kind.
    pub(super) fn reported(&self, what: &str) -> Option<&Value> {
        self.past.iter().rfind(|r| r["what"] == what)
    }

    /// How many reports of a kind there were.
    pub(super) fn count(&self, what: &str) -> usize {
        self.past.iter().filter(|r| r["what"] == what).count()
    }

    /// Checks how many reports of some kinds there were.
    #[track_caller]
    pub(super) fn assert_counts(&mut self, wanted: &[(&str, usize)]) {
        let counts: Vec<_> = wanted.iter().map(|&(what, _)| (what, self.count(what))).collect();
        assert_eq!(counts, wanted, "{}", self.story());
    }

    /// Checks that the bakes of a model told how far they are, and went forward.
    #[track_caller]
    pub(super) fn assert_rising_progress(&self, path: &str) {
        let progress = self.past.iter().filter(|r| r["what"] == "progress" && r["path"] == path);
        let fractions: Vec<f64> = progress.filter_map(|r| r["fraction"].as_f64()).collect();
        assert!(fractions.len() > 3 && fractions.is_sorted() && fractions.last() <= Some(&1.0), "{fractions:?}");
    }

    /// The fewest levels that any model was loaded with.
    pub(super) fn fewest_levels(&self) -> u64 {
        self.past.iter().filter_map(|r| r["levels"].as_u64()).min().expect("a model was loaded")
    }

    #[track_caller]
    pub(super) fn assert_not_logged(&mut self, text: &str) {
        let story = self.story();
        assert!(!story.contains(text), "{story}");
    }

    /// Ends a game that had nothing to bake and never showed a model without levels.
    #[track_caller]
    pub(super) fn quit_without_bakes(mut self) {
        assert!(self.count("started") == 0 && self.fewest_levels() > 0, "{}", self.story());
        self.quit();
    }

    /// Ends the game as a player does; returns its last report.
    #[track_caller]
    pub(super) fn quit(mut self) -> Value {
        drop(self.child.stdin.take());
        let last = self.wait("the end", |r| r["what"] == "end");
        let status = self.child.wait().expect("ends");
        assert!(status.success(), "{status}\n{}", self.story());
        last
    }

    /// Ends the game at once, without a chance to do anything.
    pub(super) fn kill(mut self) {
        self.child.kill().expect("kills");
        self.child.wait().expect("ends");
    }

    /// Everything for a message.
    fn story(&mut self) -> String {
        let reports: Vec<String> = self.past.iter().map(Value::to_string).collect();
        self.logged.extend(self.log.try_iter());
        format!("reports:\n{}\nlog:\n{}", reports.join("\n"), self.logged.join("\n"))
    }
}

impl Drop for Game {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The files below a folder, in order.
pub(super) fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok) {
        let path = entry.path();
        if path.is_dir() { files.extend(files_below(&path)) } else { files.push(path) }
    }
    files.sort();
    files
}
