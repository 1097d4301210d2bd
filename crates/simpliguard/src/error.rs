//! The one error type of the crate.

use std::fmt;

/// Names a stage of the pipeline. The order is that of [`crate::STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StageId {
    /// glTF to [`crate::data::Model`].
    Import,
    /// Views of the source.
    Views,
    /// Watertight surface around the source.
    Reconstruct,
    /// Candidates collapsed to the budgets, the best selected.
    Simplify,
    /// Charts and texture coordinates.
    Unwrap,
    /// Skin influences of the level.
    Skinning,
    /// Initial texture.
    Texture,
    /// Differentiable rendering.
    Refine,
    /// Texture set on the final vertices.
    Maps,
    /// Source and levels to binary glTF.
    Export,
}

impl fmt::Display for StageId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Import => "import",
            Self::Views => "views",
            Self::Reconstruct => "reconstruct",
            Self::Simplify => "simplify",
            Self::Unwrap => "unwrap",
            Self::Skinning => "skinning",
            Self::Texture => "texture",
            Self::Refine => "refine",
            Self::Maps => "maps",
            Self::Export => "export",
        })
    }
}

/// The reason why a bake stopped. A message names the asset and the stage, what was found, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The bytes are no glTF, or break its rules so badly that nothing can be read.
    #[error("{asset}: {stage}: {found}; {advice}")]
    Invalid {
        /// Name of the asset as given in [`crate::Source::name`].
        asset: String,
        /// The stage that found it.
        stage: StageId,
        /// The finding, with the offending index or value.
        found: String,
        /// Advice for the user.
        advice: String,
    },
    /// A file that the glTF refers to could not be read.
    #[error("{asset}: {stage}: cannot read '{uri}': {reason}; put the file beside the model or correct the URI")]
    Resource {
        /// Name of the asset.
        asset: String,
        /// The stage that asked for it.
        stage: StageId,
        /// The URI as written in the glTF.
        uri: String,
        /// The reader's reason.
        reason: String,
    },
    /// The file requires a glTF extension that cannot be decoded.
    #[error("{asset}: import: requires the extension {extension}, which is not decoded; {advice}")]
    Extension {
        /// Name of the asset.
        asset: String,
        /// The extension's name.
        extension: String,
        /// A way to convert the file, such as a command.
        advice: String,
    },
    /// The input exceeds one of the limits that protect the machine.
    #[error("{asset}: {stage}: {what} is {found}, over the limit of {limit}; reduce it or raise the limit")]
    Limit {
        /// Name of the asset.
        asset: String,
        /// The stage that found it.
        stage: StageId,
        /// The quantity that was measured, with its unit.
        what: String,
        /// Its value.
        found: u64,
        /// The limit.
        limit: u64,
    },
    /// A setting is out of its range, or has an unknown name.
    #[error("settings: {0}")]
    Settings(String),
    /// The bake was cancelled through [`crate::Cancellation`].
    #[error("{asset}: cancelled")]
    Cancelled {
        /// Name of the asset.
        asset: String,
    },
}

impl Error {
    /// An [`Error::Invalid`].
    pub fn invalid(
        asset: impl Into<String>,
        stage: StageId,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self::Invalid { asset: asset.into(), stage, found: found.into(), advice: advice.into() }
    }
}
