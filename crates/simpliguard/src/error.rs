//! The one error type of the crate.

use std::fmt;

use bytesize::ByteSize;

/// Names a stage of the pipeline. The order is that of [`crate::STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
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

/// A text from a file or a name of a file, for a line of a message: characters that steer a terminal or hide what is
/// written are shown by their numbers, such as `\u{1b}`.
#[derive(Clone, Copy, Debug)]
pub struct Printable<'a>(pub &'a str);

impl Printable<'_> {
    /// Tells whether a character is shown by its number: control characters but the tab, the ends of lines of Unicode, and
    /// marks that turn the direction of writing.
    pub fn is_escaped(c: char) -> bool {
        let is_mark = matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        is_mark || c.is_control() && c != '\t'
    }
}

impl fmt::Display for Printable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = self.0;
        while let Some((at, c)) = rest.char_indices().find(|(_, c)| Self::is_escaped(*c)) {
            write!(f, "{}{}", &rest[..at], c.escape_unicode())?;
            rest = &rest[at + c.len_utf8()..];
        }
        f.write_str(rest)
    }
}

/// The reason why a bake stopped. A message names the asset and the stage, what was found, and what to do about it.
#[derive(Debug, thiserror::Error, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Error {
    /// The bytes are no glTF, or break its rules so badly that nothing can be read.
    #[error("{}: {stage}: {}; {advice}", Printable(asset), Printable(found))]
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
    #[error(
        "{}: {stage}: cannot read '{}': {}; put the file beside the model or correct the URI",
        Printable(asset),
        Printable(uri),
        Printable(reason)
    )]
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
    #[error(
        "{}: import: requires the extension {}, which is not decoded; {advice}",
        Printable(asset),
        Printable(extension)
    )]
    Extension {
        /// Name of the asset.
        asset: String,
        /// The extension's name.
        extension: String,
        /// A way to convert the file, such as a command.
        advice: String,
    },
    /// The input exceeds one of the limits that protect the machine.
    #[error(
        "{}: {stage}: {what} is {found}, over the limit of {limit}; reduce it or raise the limit",
        Printable(asset)
    )]
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
    /// The bake would take more memory than it may. Nothing was allocated for it.
    #[error(
        "{}: {stage}: {what} would take {} of memory, and a bake may take {}; reduce it, or give more with `--memory` or \
         `SimpliguardPlugin::memory`",
        Printable(asset),
        ByteSize(*needed),
        ByteSize(*limit)
    )]
    Memory {
        /// Name of the asset.
        asset: String,
        /// The stage that found it.
        stage: StageId,
        /// The part of the asset that takes the memory.
        what: String,
        /// Bytes that it would take, estimated.
        needed: u64,
        /// Bytes that the bake may take in all.
        limit: u64,
    },
    /// A level misses one of its bars, and `on_miss` is `Fail`.
    #[error(
        "{}: maps: LOD{level}: {}; raise its `faces`, lower the bar, or set `on_miss: Warn`",
        Printable(asset),
        Printable(found)
    )]
    Gate {
        /// Name of the asset.
        asset: String,
        /// Number of the level, from 1, the smallest.
        level: u32,
        /// The figures and their bars.
        found: String,
    },
    /// A setting is out of its range, or has an unknown name.
    #[error("settings: {}", Printable(.0))]
    Settings(String),
    /// The bake was cancelled through [`crate::Cancellation`].
    #[error("{}: cancelled", Printable(asset))]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_files_do_not_steer_a_terminal() {
        let printable = |text: &str| Printable(text).to_string();
        assert_eq!(printable("\x1b[2Jfox\r\n\u{7f}\u{9b}1m"), "\\u{1b}[2Jfox\\u{d}\\u{a}\\u{7f}\\u{9b}1m");
        assert_eq!(printable("gpj.\u{202e}exe"), "gpj.\\u{202e}exe");
        for plain in ["", "fox\t1.glb", "f\u{fc}chse \u{72d0}.glb"] {
            assert_eq!(printable(plain), plain);
        }
        let error = Error::invalid("a\x1b.glb", StageId::Import, "found \x07", "do it");
        assert_eq!(error.to_string(), "a\\u{1b}.glb: import: found \\u{7}; do it");
        assert_eq!(Error::Settings("'\x1b'".into()).to_string(), "settings: '\\u{1b}'");
    }
}
