//! The version of the pipeline, and how it was compiled.

/// Part of every cache key. Raise it whenever the output of any stage changes for equal input and settings.
pub const PIPELINE_VERSION: &str = "31";

/// The `opt-level` this crate was compiled with. Below `2` a bake takes many times as long.
pub const OPT_LEVEL: &str = env!("SIMPLIGUARD_OPT_LEVEL");
