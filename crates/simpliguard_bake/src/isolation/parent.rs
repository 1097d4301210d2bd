//! The program that lets a child bake.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, BufWriter};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use simpliguard::settings::BakeSettings;
use simpliguard::{Context, Error, Progress, Source, StageId};
use simpliguard_cache::Cache;

use super::messages::{CHILD_VAR, Message};
use super::request::{self, Terms, Wanted};
use crate::device::Processor;
use crate::host::{Host, Notice};
use crate::result::{BakeResult, Parts};

/// Time in which a child must have begun to serve. A game may do much before it adds its plugins.
const START: Duration = Duration::from_secs(30);
/// Time between two looks at the cancellation.
const TICK: Duration = Duration::from_millis(20);

/// How a program starts itself to bake in a process of its own. The started program must see
/// [`is_child`](super::is_child) and call [`serve`](super::serve).
#[derive(Clone, Debug)]
pub struct Isolation {
    program: PathBuf,
    args: Vec<OsString>,
    /// Number of threads that compute in the child.
    threads: usize,
}

/// The reason why a child gave no answer.
enum Stop {
    /// The bake has to be done by the parent: there is no child that serves.
    NoChild(io::Error),
    /// The bake failed.
    Failed(Error),
}

impl Isolation {
    /// Starts this program with its own arguments.
    ///
    /// # Errors
    /// If the system does not tell which program this is.
    pub fn new(threads: usize) -> io::Result<Self> {
        Ok(Self { program: std::env::current_exe()?, args: std::env::args_os().skip(1).collect(), threads })
    }

    /// Starts another program.
    #[cfg(test)]
    pub(super) fn of(program: PathBuf, args: &[&str]) -> Self {
        Self { program, args: args.iter().map(OsString::from).collect(), threads: 1 }
    }

    /// Bakes in a child. `None` if no child can be started: the host is told, and the caller bakes itself.
    ///
    /// # Errors
    /// Those of the pipeline; [`Error::Invalid`] if the child ended without a result, as by a crash or for lack of memory.
    pub(crate) fn bake(
        &self,
        bake: (&Source<'_>, &BakeSettings, Option<&Cache>),
        terms: (Parts<'_>, Processor),
        (context, host): (&Context<'_>, &impl Host),
    ) -> Result<Option<BakeResult>, Error> {
        match self.try_bake(bake, terms, (context, host)) {
            Ok(result) => Ok(Some(result)),
            Err(Stop::Failed(error)) => Err(error),
            Err(Stop::NoChild(error)) => {
                host.notify(Notice::NotIsolated(error));
                Ok(None)
            }
        }
    }

    fn try_bake(
        &self,
        (source, settings, cache): (&Source<'_>, &BakeSettings, Option<&Cache>),
        (parts, processor): (Parts<'_>, Processor),
        (context, host): (&Context<'_>, &impl Host),
    ) -> Result<BakeResult, Stop> {
        let folder = tempfile::Builder::new().prefix("simpliguard-").tempdir().map_err(Stop::NoChild)?;
        let mut child = Running::start(self).map_err(Stop::NoChild)?;
        child.wait_until_ready(source.name, context)?;
        let terms = Terms {
            wanted: match parts {
                Parts::Combined => Wanted::Combined,
                Parts::Levels => Wanted::Levels,
                Parts::Sheet(_) => Wanted::Sheet,
            },
            preview: context.preview.is_some(),
            memory: context.memory,
            processor,
            threads: self.threads,
            folder: folder.path().to_owned(),
        };
        // A child that ends meanwhile closes its input, which its status explains better.
        let _ = request::write(&mut BufWriter::new(&mut child.input), source, settings, cache, terms);
        child.follow(source.name, context, host, folder.path())
    }
}

/// A child at work. It is killed when it is dropped.
struct Running {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Message>,
}

impl Drop for Running {
    fn drop(&mut self) {
        // Both fail only where it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Running {
    fn start(isolation: &Isolation) -> io::Result<Self> {
        let mut child = Command::new(&isolation.program)
            .args(&isolation.args)
            .env(CHILD_VAR, "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(io::Error::other("it has no pipes"));
        };
        let (sender, messages) = mpsc::channel();
        // It ends with the output of the child.
        thread::Builder::new().name("simpliguard child".to_owned()).spawn(move || {
            let lines = BufReader::new(output).split(b'\n').map_while(Result::ok);
            let messages = lines.filter_map(|line| Message::parse(&String::from_utf8_lossy(&line)));
            messages.map_while(|message| sender.send(message).ok()).for_each(drop);
        })?;
        Ok(Self { child, input, messages })
    }

    fn wait_until_ready(&mut self, asset: &str, context: &Context<'_>) -> Result<(), Stop> {
        let start = Instant::now();
        loop {
            context.check(asset).map_err(Stop::Failed)?;
            let late = || io::Error::other(format!("the program did not serve within {} s", START.as_secs()));
            match self.messages.recv_timeout(TICK) {
                Ok(Message::Ready) => return Ok(()),
                Err(RecvTimeoutError::Timeout) if start.elapsed() > START => return Err(Stop::NoChild(late())),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Stop::NoChild(io::Error::other("the program ended before it served")));
                }
                _ => {}
            }
        }
    }

    /// Passes the messages on until there is a result.
    fn follow(
        &mut self,
        asset: &str,
        context: &Context<'_>,
        host: &impl Host,
        folder: &Path,
    ) -> Result<BakeResult, Stop> {
        let mut last = StageId::Import;
        loop {
            context.check(asset).map_err(Stop::Failed)?;
            match self.messages.recv_timeout(TICK) {
                Ok(Message::Progress { stage, level, fraction }) => {
                    last = stage;
                    context.progress.iter().for_each(|sink| sink.report(Progress { stage, level, fraction }));
                }
                Ok(Message::Object { name, is_cached }) => host.object(&name, is_cached),
                Ok(Message::Notice { text, is_warning }) => host.notify(Notice::OfChild { text, is_warning }),
                Ok(Message::Preview(file)) => {
                    let glb = std::fs::read(folder.join(file)).ok();
                    glb.into_iter().zip(context.preview).for_each(|(glb, sink)| sink.show(glb));
                }
                Ok(Message::Done(parts)) => return parts.read(folder).map_err(|e| self.lost(asset, &e)),
                Ok(Message::Failed(error)) => return Err(Stop::Failed(error)),
                Ok(Message::Ready) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(Stop::Failed(self.ended(asset, last))),
            }
        }
    }

    /// The error of a child that ended without a result.
    fn ended(&mut self, asset: &str, stage: StageId) -> Error {
        let how = self.child.wait().map_or_else(|e| e.to_string(), |status| status.to_string());
        let found = format!("the process of the bake ended ({how}): it crashed, or the system lacks memory");
        Error::invalid(asset, stage, found, "reduce the model; the others are baked all the same")
    }

    fn lost(&self, asset: &str, error: &io::Error) -> Stop {
        let found = format!("the result of the process of the bake cannot be read: {error}");
        Stop::Failed(Error::invalid(asset, StageId::Export, found, "check the space in the folder of temporary files"))
    }
}
