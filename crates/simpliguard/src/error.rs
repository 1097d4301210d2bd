//! The one error type of the chain.

use std::fmt;

/// Names the stage an error or a time belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StageId {
    /// Settings are resolved and checked.
    Settings,
    /// glTF to [`crate::data::Model`].
    Import,
    /// Watertight surface around the source.
    Reconstruct,
    /// Collapse to the budget, unseen faces dropped.
    Shape,
    /// Skin influences of the level.
    Rig,
    /// Charts and texture coordinates.
    Unwrap,
    /// Initial textures.
    Texture,
    /// Differentiable rendering.
    Refine,
    /// Level meshes to binary glTF.
    Export,
}

impl fmt::Display for StageId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Settings => "settings",
            Self::Import => "import",
            Self::Reconstruct => "reconstruct",
            Self::Shape => "shape",
            Self::Rig => "rig",
            Self::Unwrap => "unwrap",
            Self::Texture => "texture",
            Self::Refine => "refine",
            Self::Export => "export",
        })
    }
}

/// What stopped a bake. Every message names the asset, the stage, what was found and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The bytes are no glTF, or break its rules in a way that leaves nothing to work on.
    #[error("{asset}: {stage}: {found}; {advice}")]
    Invalid {
        /// Name of the asset as given in [`crate::Source::name`].
        asset: String,
        /// Where it was found.
        stage: StageId,
        /// What was found, with the offending index or value.
        found: String,
        /// What the user can do.
        advice: String,
    },
    /// A file the glTF refers to could not be read.
    #[error("{asset}: {stage}: cannot read '{uri}': {reason}; put the file beside the model or correct the URI")]
    Resource {
        /// Name of the asset.
        asset: String,
        /// Where it was asked for.
        stage: StageId,
        /// The URI as the glTF spells it.
        uri: String,
        /// The reader's reason.
        reason: String,
    },
    /// A required glTF extension that cannot be decoded.
    #[error("{asset}: import: requires the extension {extension}, which is not decoded; {advice}")]
    Extension {
        /// Name of the asset.
        asset: String,
        /// The extension's name.
        extension: String,
        /// The command that converts the file.
        advice: String,
    },
    /// An input over one of the limits that protect the machine.
    #[error("{asset}: {stage}: {what} is {found}, over the limit of {limit}; reduce it or raise the limit")]
    Limit {
        /// Name of the asset.
        asset: String,
        /// Where it was found.
        stage: StageId,
        /// The measured quantity, with its unit.
        what: String,
        /// Its value.
        found: u64,
        /// The limit.
        limit: u64,
    },
    /// A settings value out of its range, or an unknown name.
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
