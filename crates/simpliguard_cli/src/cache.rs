//! `simpliguard cache`: the content of the cache, its checks and its removal, and keys for a shared one.

mod keygen;
mod rebake;

use bytesize::ByteSize;
use serde::Serialize;
use simpliguard_bake::CachePlace;
use simpliguard_cache::{Amount, Cache, Collected, Counters, TierCounters, Usage};

use self::rebake::{Rebaked, rebake};
use crate::Exit;
use crate::args::{CacheArgs, CacheCommand};
use crate::console;
use crate::error::UsageError;
use crate::output::{json_text, write_stdout};
use crate::project::ProjectCache;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

#[derive(Serialize)]
struct Document<'a> {
    version: u32,
    folder: String,
    /// In bytes.
    max_size: u64,
    #[serde(flatten)]
    outcome: &'a Outcome,
    /// The counts of all runs so far, of `stats`.
    #[serde(skip_serializing_if = "Option::is_none")]
    tiers: Option<Counters>,
    /// Of `verify --rebake`.
    #[serde(skip_serializing_if = "Option::is_none")]
    rebaked: Option<&'a Rebaked>,
}

/// The outcome of a command.
#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Outcome {
    Usage(Usage),
    Collected(Collected),
    Verified { checked: Amount, damaged: Vec<String>, incomplete: u64 },
    Cleared { freed: u64 },
    Failed(String),
}

/// Carries the command out.
pub(crate) fn run(args: &CacheArgs) -> Result<Exit, UsageError> {
    if let CacheCommand::Keygen { file } = &args.command {
        return write_stdout(&format!("{}\n", keygen::write(file)?)).map(|()| Exit::Done);
    }
    let project = ProjectCache::of(args.project.as_deref())?;
    let explicit = CachePlace { dir: args.cache_dir.as_deref(), shared: None };
    let cache = project.open(explicit, |outside| console::warning(&outside.to_string()));
    let cache = cache.ok_or_else(|| UsageError("there is no user's cache folder; give --cache-dir".into()))?;
    // The other commands report a foreign folder as an error.
    if let (CacheCommand::Stats | CacheCommand::Verify { .. }, Err(error)) = (&args.command, cache.check()) {
        console::warning(&error.to_string());
    }
    let outcome = carry_out(&args.command, &cache);
    let rebaked = match &args.command {
        CacheCommand::Verify { rebake: Some(fraction), assets } => Some(rebake(assets, args, *fraction)?),
        _ => None,
    };
    let errors: Vec<&str> = outcome.errors().chain(rebaked.iter().flat_map(Rebaked::errors)).collect();
    errors.iter().for_each(|error| console::error(error));
    let tiers = matches!(args.command, CacheCommand::Stats).then(|| cache.counters());
    let rebaked = rebaked.as_ref();
    if args.json {
        let (folder, max_size) = (cache.root().display().to_string(), cache.max_size());
        let document = Document { version: DOCUMENT_VERSION, folder, max_size, outcome: &outcome, tiers, rebaked };
        write_stdout(&json_text(&document)?)?;
    } else {
        let tiers = tiers.as_ref().map(tiers_text).unwrap_or_default();
        write_stdout(&(outcome.text(&cache) + &tiers + &rebaked.map(Rebaked::text).unwrap_or_default()))?;
    }
    Ok(if errors.is_empty() { Exit::Done } else { Exit::SomeFailed })
}

fn carry_out(command: &CacheCommand, cache: &Cache) -> Outcome {
    match command {
        CacheCommand::Stats => Outcome::Usage(cache.usage()),
        CacheCommand::Gc { max_size } => match cache.collect(max_size.unwrap_or(cache.max_size())) {
            Ok(Some(collected)) => Outcome::Collected(collected),
            Ok(None) => Outcome::Failed("another collection is under way; try again when it has ended".into()),
            Err(error) => Outcome::Failed(error.to_string()),
        },
        CacheCommand::Verify { .. } => {
            let verified = cache.verify();
            let damaged = verified.errors.iter().map(ToString::to_string).collect();
            Outcome::Verified { checked: verified.checked, damaged, incomplete: verified.incomplete }
        }
        CacheCommand::Clear => match cache.clear() {
            Ok(freed) => Outcome::Cleared { freed },
            Err(error) => Outcome::Failed(error.to_string()),
        },
        CacheCommand::Keygen { .. } => Outcome::Failed("a key needs no cache".into()),
    }
}

impl Outcome {
    fn errors(&self) -> impl Iterator<Item = &str> {
        let errors = match self {
            Self::Verified { damaged, .. } => damaged.as_slice(),
            Self::Failed(error) => std::slice::from_ref(error),
            _ => &[],
        };
        errors.iter().map(String::as_str)
    }

    fn text(&self, cache: &Cache) -> String {
        match self {
            Self::Usage(usage) => usage_text(usage, cache),
            Self::Collected(Collected { results, stages, freed, left }) => format!(
                "removed {results} results and {stages} stage objects, {} in all; {} are left\n",
                ByteSize(*freed),
                ByteSize(*left)
            ),
            Self::Verified { checked, damaged, incomplete } => {
                format!("checked {}: {} damaged, {incomplete} incomplete results\n", amount(checked), damaged.len())
            }
            Self::Cleared { freed } => format!("removed {}\n", ByteSize(*freed)),
            Self::Failed(_) => String::new(),
        }
    }
}

fn usage_text(usage: &Usage, cache: &Cache) -> String {
    let Usage { results, incomplete, objects, unreferenced, stages, quarantine, bytes } = usage;
    let lines = [
        ("folder", cache.root().display().to_string()),
        ("size", format!("{} of {}", ByteSize(*bytes), ByteSize(cache.max_size()))),
        ("results", format!("{}, of them {} incomplete", results.files, incomplete.files)),
        ("objects", format!("{}, of them {} in no result", amount(objects), amount(unreferenced))),
        ("stages", amount(stages)),
        ("quarantine", amount(quarantine)),
    ];
    lines.iter().map(|(name, value)| format!("{name:<11} {value}\n")).collect()
}

/// A line for each tier that was used.
fn tiers_text(counters: &Counters) -> String {
    let line = |(name, tier): (&str, &TierCounters)| {
        let TierCounters { hits, misses, stored, damaged, untrusted, failures, requests, bytes_read, bytes_written } =
            tier;
        let mut text = format!("{name:<11} {hits} hits, {misses} misses, {stored} stored, {damaged} damaged");
        if name == "shared" {
            let (read, written) = (ByteSize(*bytes_read), ByteSize(*bytes_written));
            text += &format!(
                ", {untrusted} untrusted, {failures} failures; {requests} requests, {read} read, {written} written"
            );
        }
        text + "\n"
    };
    [("local", &counters.local), ("shared", &counters.shared)].into_iter().map(line).collect()
}

fn amount(amount: &Amount) -> String {
    let Amount { files, bytes } = amount;
    format!("{files} files with {}", ByteSize(*bytes))
}
