//! The project file `config/simpliguard.ron`: defaults, rules and profiles.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::time::Duration;

use bytesize::ByteSize;
use globset::GlobMatcher;
use serde::de::{Deserializer, Error as _};
use serde::{Deserialize, Serialize};

use super::fields::BakeOverrides;
use super::resolve::{Layer, Origin};
use super::text::{did_you_mean, parse};
use crate::Error;
use crate::data::compile_glob;

/// A project file:
///
/// ```ron
/// (
///     defaults: (texture_size: 2048),
///     rules: [(glob: "props/**", settings: (faces: [250, 500]))],
///     profiles: {"vr": (quality: Best)},
///     cache: (dir: "cache", max_size: "5 GiB"),
///     plugin: (mode: Progressive, threads: 2),
///     backend: Auto,
/// )
/// ```
#[derive(Clone, Debug, Default)]
pub struct ProjectFile {
    file: String,
    /// Overrides for every model.
    pub defaults: BakeOverrides,
    /// Overrides for models whose path matches; later rules win.
    pub rules: Vec<Rule>,
    /// Overrides for a platform or a purpose, chosen by name.
    pub profiles: BTreeMap<String, BakeOverrides>,
    /// Settings that are part of no key.
    pub project: ProjectSettings,
}

/// Settings of a project that never change a byte of the output, or, as the backend, by rounding alone.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ProjectSettings {
    /// The cache of results.
    pub cache: CacheSettings,
    /// The moment at which a game shows the levels.
    pub mode: Option<BakeMode>,
    /// Number of threads that bake while a game runs.
    pub threads: Option<NonZeroU32>,
    /// The priority of these threads, relative to the threads of the game.
    pub priority: Option<BakePriority>,
    /// True if a game bakes in processes of their own.
    pub isolate: Option<bool>,
    /// Most work of a GPU in each frame of a game that bakes.
    pub gpu_time: Option<Duration>,
    /// The processor that refines levels.
    pub backend: Option<BackendChoice>,
}

/// The processor that refines levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum BackendChoice {
    /// A GPU, if the machine has one, else the CPU.
    Auto,
    /// The CPU. It gives the same bytes on every machine.
    #[default]
    Cpu,
    /// A GPU, and the CPU with a warning if there is none.
    Gpu,
}

/// The places and the size of the cache.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(default, deny_unknown_fields, rename = "cache")]
pub struct CacheSettings {
    /// Folder, relative to the project's folder. A folder outside of it is not used.
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    pub dir: Option<String>,
    /// Most bytes of the cache. Results that were used longest ago are deleted first.
    #[serde(deserialize_with = "max_size")]
    pub max_size: Option<u64>,
    /// A cache that several machines share: a folder, relative to the project's folder, or an address such as
    /// `s3://bucket/folder`.
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    pub shared: Option<String>,
    /// True if the shared cache is read but not written.
    pub shared_read_only: bool,
}

/// The moment at which a game that bakes its own models shows the levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum BakeMode {
    /// Models appear at once, without levels. Their levels are added when they are done.
    #[default]
    Progressive,
    /// A model appears when its levels are done. This is for builds and automatic tests.
    Blocking,
}

/// The priority of bakes in a game that runs on the same cores.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum BakePriority {
    /// Bakes take the time that the game leaves.
    Lowest,
    /// Bakes get about a tenth of the time of cores that the game keeps busy.
    Low,
    /// Bakes get as much time as the game.
    Normal,
}

/// Overrides for some of the models.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    #[serde(deserialize_with = "matcher")]
    glob: GlobMatcher,
    /// The overrides.
    pub settings: BakeOverrides,
}

impl Rule {
    /// The pattern as written.
    pub fn glob(&self) -> &str {
        self.glob.glob().glob()
    }

    /// True if the rule applies to the model at `path`, which is relative to the asset folder and separated by `/`.
    pub fn applies_to(&self, path: &str) -> bool {
        self.glob.is_match(path)
    }
}

/// Reads a glob. `*` stays within a folder and `**` crosses folders, on every platform.
fn matcher<'de, D: Deserializer<'de>>(deserializer: D) -> Result<GlobMatcher, D::Error> {
    let pattern = String::deserialize(deserializer)?;
    let glob = compile_glob(&pattern, |glob| {
        glob.literal_separator(true).backslash_escape(true);
    });
    glob.map_err(|e| D::Error::custom(format!("glob: {e}")))
}

#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields, rename = "ProjectFile")]
struct Contents {
    defaults: BakeOverrides,
    rules: Vec<Rule>,
    profiles: BTreeMap<String, BakeOverrides>,
    cache: CacheSettings,
    plugin: PluginContents,
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    backend: Option<BackendChoice>,
}

/// Smallest size of a cache. With less, the unit is probably missing.
const LEAST_CACHE: ByteSize = ByteSize::mib(1);

/// Reads the size of a cache in bytes, as users write it: a number with its unit, such as `500 MB` or `1.5 GiB`.
///
/// # Errors
/// If it is malformed, or too small; the text says what was expected.
pub fn parse_cache_size(text: &str) -> Result<u64, String> {
    let size = text.parse::<ByteSize>().ok().filter(|size| *size >= LEAST_CACHE);
    let expected = || format!("expected at least {LEAST_CACHE}, with a unit, such as 500 MB or 1.5 GiB");
    size.map(|size| size.as_u64()).ok_or_else(expected)
}

fn max_size<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u64>, D::Error> {
    let text = String::deserialize(deserializer)?;
    parse_cache_size(&text).map(Some).map_err(|expected| D::Error::custom(format!("max_size: {expected}")))
}

#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields, rename = "plugin")]
struct PluginContents {
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    mode: Option<BakeMode>,
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    threads: Option<NonZeroU32>,
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    priority: Option<BakePriority>,
    #[serde(with = "serde_with::rust::unwrap_or_skip")]
    isolate: Option<bool>,
    #[serde(deserialize_with = "milliseconds")]
    gpu_ms_per_frame: Option<Duration>,
}

/// Least time of a GPU in a frame, in milliseconds. With less, a bake would take hours.
const LEAST_GPU_MS: f32 = 0.1;
/// Most time of a GPU in a frame, in milliseconds.
const MOST_GPU_MS: f32 = 1000.0;

fn milliseconds<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Duration>, D::Error> {
    let ms = f32::deserialize(deserializer)?;
    if (LEAST_GPU_MS..=MOST_GPU_MS).contains(&ms) {
        return Ok(Some(Duration::from_secs_f32(ms / 1000.0)));
    }
    Err(D::Error::custom(format!("gpu_ms_per_frame: expected {LEAST_GPU_MS} to {MOST_GPU_MS}")))
}

impl ProjectFile {
    /// Path of the file in a project.
    pub const PATH: &'static str = "config/simpliguard.ron";

    /// Reads a project file. `file` is for messages and origins.
    ///
    /// # Errors
    /// If the text is malformed, or names a field or a value that does not exist.
    pub fn parse(text: &str, file: &str) -> Result<Self, Error> {
        let Contents { defaults, rules, profiles, cache, plugin, backend } = parse(text, file)?;
        let PluginContents { mode, threads, priority, isolate, gpu_ms_per_frame: gpu_time } = plugin;
        let project = ProjectSettings { cache, mode, threads, priority, isolate, gpu_time, backend };
        Ok(Self { file: file.to_owned(), defaults, rules, profiles, project })
    }

    /// The layers that lie below a model's `.meta`: defaults, matching rules in their order, then the profile. `path`
    /// is the model's path, relative to the asset folder and separated by `/`.
    ///
    /// # Errors
    /// If the file has no such profile.
    pub fn layers(&self, path: &str, profile: Option<&str>) -> Result<Vec<Layer>, Error> {
        let file = || self.file.clone();
        let mut layers = vec![Layer { origin: Origin::Project { file: file() }, overrides: self.defaults.clone() }];
        layers.extend(self.rules.iter().filter(|rule| rule.applies_to(path)).map(|rule| Layer {
            origin: Origin::Rule { file: file(), glob: rule.glob().to_owned() },
            overrides: rule.settings.clone(),
        }));
        if let Some(name) = profile {
            let overrides = self.profiles.get(name).ok_or_else(|| self.no_profile(name))?.clone();
            layers.push(Layer { origin: Origin::Profile { file: file(), name: name.to_owned() }, overrides });
        }
        Ok(layers)
    }

    fn no_profile(&self, name: &str) -> Error {
        let known: Vec<&str> = self.profiles.keys().map(String::as_str).collect();
        let place = if self.file.is_empty() { Self::PATH } else { &self.file };
        let hint = if known.is_empty() { "; it has none".to_owned() } else { did_you_mean(name, &known) };
        Error::Settings(format!("{place}: no profile named '{name}'{hint}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Quality, resolve};

    const TEXT: &str = r#"(
        defaults: (texture_size: 2048),
        rules: [
            (glob: "props/**", settings: (faces: [250, 500], gutter: 2)),
            (glob: "props/*.glb", settings: (gutter: 3)),
        ],
        profiles: {"vr": (quality: Best)},
        cache: (dir: "../cache", max_size: "1.5 GiB", shared: "s3://levels", shared_read_only: true),
        plugin: (mode: Blocking, threads: 3, priority: Low, isolate: true, gpu_ms_per_frame: 2.5),
        backend: Gpu,
    )"#;

    #[test]
    fn rules_match_by_path_and_the_last_wins() {
        let file = ProjectFile::parse(TEXT, "config/simpliguard.ron").expect("valid");
        let resolved = |path, profile| resolve(file.layers(path, profile).expect("layers")).expect("valid");
        let deep = resolved("props/a/chair.glb", None);
        assert_eq!((deep.settings.gutter, deep.settings.texture_size.clone()), (2, 2048.into()));
        assert_eq!(resolved("props/chair.glb", None).settings.gutter, 3);
        let other = resolved("fox.glb", Some("vr"));
        assert_eq!((other.settings.gutter, other.settings.quality), (4, Quality::Best));
        assert_eq!(
            deep.origin("faces").map(ToString::to_string).as_deref(),
            Some("config/simpliguard.ron, rule \"props/**\"")
        );
        assert_eq!(file.project.cache.dir.as_deref(), Some("../cache"));
        assert_eq!(file.project.cache.max_size, Some(3 << 29));
        assert_eq!(file.project.cache.shared.as_deref(), Some("s3://levels"));
        assert!(file.project.cache.shared_read_only);
        assert_eq!((file.project.mode, file.project.threads), (Some(BakeMode::Blocking), NonZeroU32::new(3)));
        assert_eq!((file.project.priority, file.project.isolate), (Some(BakePriority::Low), Some(true)));
        assert_eq!(file.project.backend, Some(BackendChoice::Gpu));
        assert_eq!(file.project.gpu_time, Some(Duration::from_micros(2500)));
    }

    #[test]
    fn an_unknown_profile_is_named() {
        let file = ProjectFile::parse(TEXT, "p.ron").expect("valid");
        let message = file.layers("a", Some("vt")).expect_err("unknown").to_string();
        assert_eq!(message, "settings: p.ron: no profile named 'vt'; did you mean 'vr'?");
    }

    #[test]
    fn mistakes_are_located() {
        let message = |text: &str| ProjectFile::parse(text, "p.ron").expect_err(text).to_string();
        assert_eq!(
            message("(\n default: ())"),
            "settings: p.ron:2:2: unknown field 'default'; did you mean 'defaults'?"
        );
        assert_eq!(
            message("(rules: [\n(glob: \"*\", settings: (fces: [1]))])"),
            "settings: p.ron:2:24: unknown field 'fces'; did you mean 'faces'?"
        );
        assert_eq!(
            message("(cache: (\n max_size: \"5\"))"),
            "settings: p.ron:2:13: max_size: expected at least 1.0 MiB, with a unit, such as 500 MB or 1.5 GiB"
        );
        assert_eq!(
            message("(plugin: (\n priority: Lowset))"),
            "settings: p.ron:2:12: unknown value 'Lowset'; did you mean 'Lowest'?"
        );
        assert!(message("(rules: [\n(glob: \"[\", settings: ())])").starts_with("settings: p.ron:2:"));
        assert_eq!(
            message("(plugin: (\n gpu_ms_per_frame: 0))"),
            "settings: p.ron:2:20: gpu_ms_per_frame: expected 0.1 to 1000"
        );
        let nested = format!("(rules: [\n(glob: \"{}a,b{}\", settings: ())])", "{".repeat(260), "}".repeat(260));
        assert!(message(&nested).contains("glob: it is too complex"));
    }
}
