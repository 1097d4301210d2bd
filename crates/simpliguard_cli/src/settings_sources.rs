//! The settings that a command line gives.

use std::path::PathBuf;

use simpliguard::settings::{BakeOverrides, Layer, Origin, parse_overrides};

use crate::error::UsageError;
use crate::source::{read_text, shown};

/// Origins of settings. Later ones win: project defaults, matching rules, profile, `.meta`, settings file, flags.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct SettingsSources {
    /// The project, whose `config/simpliguard.ron` applies; else the nearest folder above the input with such a file.
    #[arg(long, value_name = "DIR")]
    pub(crate) project: Option<PathBuf>,
    /// A profile of the project.
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// A RON file of settings, such as `(faces: [500], quality: Draft)`.
    #[arg(long, value_name = "FILE.ron")]
    pub(crate) settings: Option<PathBuf>,
    /// One setting, such as `texture_size=2048`; may be given several times.
    #[arg(long, value_name = "FIELD=VALUE")]
    pub(crate) set: Vec<String>,
    /// Largest number of triangles of each level.
    #[arg(long, value_name = "N,N,..")]
    pub(crate) faces: Option<String>,
    /// Quality preset: time that a bake may take.
    #[arg(long, value_parser = ["draft", "standard", "best"])]
    pub(crate) quality: Option<String>,
}

impl SettingsSources {
    /// The layers above a model's own settings: the settings file, then the flags.
    pub(crate) fn layers(&self) -> Result<Vec<Layer>, UsageError> {
        let mut layers = Vec::new();
        if let Some(path) = &self.settings {
            let file = shown(path);
            let text = read_text(path).map_err(|e| UsageError(format!("cannot read {file}: {e}")))?;
            layers.push(Layer { overrides: parse_overrides(&text, &file)?, origin: Origin::File { file } });
        }
        layers.push(Layer { overrides: self.flags()?, origin: Origin::CommandLine });
        Ok(layers)
    }

    fn flags(&self) -> Result<BakeOverrides, UsageError> {
        let mut flags = BakeOverrides::default();
        for assignment in &self.set {
            let (field, value) = assignment
                .split_once('=')
                .ok_or_else(|| UsageError(format!("--set {assignment}: expected FIELD=VALUE")))?;
            flags.set(field.trim(), value)?;
        }
        for (field, value) in [("faces", &self.faces), ("quality", &self.quality)] {
            if let Some(value) = value {
                flags.set(field, value)?;
            }
        }
        Ok(flags)
    }
}
