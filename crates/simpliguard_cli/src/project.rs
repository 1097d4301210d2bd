//! The settings of a model: from its project's file, its `.meta` and the command line.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

use simpliguard::Error;
use simpliguard::settings::{BackendChoice, CacheSettings, Layer, Origin, ProjectFile, Resolved, parse_meta, resolve};
use simpliguard_bake::{CachePlace, OutsideProject, open_cache};
use simpliguard_cache::Cache;

use crate::error::UsageError;
use crate::settings_sources::SettingsSources;
use crate::source::{read_text, shown, slashed};

/// The folder and the file of a project.
#[derive(Debug, Default)]
struct Project {
    /// Absolute; `None` for models outside of any project.
    folder: Option<PathBuf>,
    file: ProjectFile,
}

/// Looks up the settings of models. Reads the file of each project once.
pub(crate) struct SettingsLookup {
    /// The project of all models, if the command line gives one.
    fixed: Option<PathBuf>,
    profile: Option<String>,
    top: Vec<Layer>,
    projects: BTreeMap<Option<PathBuf>, Project>,
}

/// The settings of one model.
pub(crate) struct ModelSettings {
    /// `Err` if the `.meta` of the model cannot be used.
    pub(crate) resolved: Result<Resolved, Error>,
    /// The cache as its project configures it.
    pub(crate) cache: ProjectCache,
    /// The processor that its project wants.
    pub(crate) backend: BackendChoice,
}

/// The cache as a project configures it.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ProjectCache {
    settings: CacheSettings,
    /// The project's folder.
    base: PathBuf,
}

impl ProjectCache {
    /// The cache of the project in `folder`, or else of the project around the current folder.
    pub(crate) fn of(folder: Option<&Path>) -> Result<Self, UsageError> {
        let here = || nearest_project(&std::env::current_dir().ok()?.join("here"));
        Ok(Project::read(folder.map(existing_folder).transpose()?.or_else(here))?.cache())
    }

    /// The project's folder. `None` outside of any project.
    pub(crate) fn project(&self) -> Option<&Path> {
        Some(self.base.as_path()).filter(|base| !base.as_os_str().is_empty())
    }

    /// Opens the cache, if there is a place for one. `explicit` is from the command line. `notify` is called if the
    /// project's file names a folder that is not used.
    pub(crate) fn open(&self, explicit: CachePlace<'_>, notify: impl FnOnce(OutsideProject)) -> Option<Cache> {
        open_cache(explicit, &self.settings, &self.base, notify)
    }
}

impl SettingsLookup {
    pub(crate) fn new(sources: &SettingsSources) -> Result<Self, UsageError> {
        let fixed = sources.project.as_deref().map(existing_folder);
        Ok(Self {
            fixed: fixed.transpose()?,
            profile: sources.profile.clone(),
            top: sources.layers()?,
            projects: BTreeMap::new(),
        })
    }

    /// The project of all models, if the command line gives one.
    pub(crate) fn fixed_project(&self) -> Option<&Path> {
        self.fixed.as_deref()
    }

    /// The settings of a model. `Err` for what is wrong with the project or the command line.
    pub(crate) fn of(&mut self, model: &Path) -> Result<ModelSettings, UsageError> {
        let absolute = std::path::absolute(model).unwrap_or_else(|_| model.to_owned());
        let absolute = absolute.canonicalize().unwrap_or(absolute);
        let folder = self.fixed.clone().or_else(|| nearest_project(&absolute));
        if !self.projects.contains_key(&folder) {
            self.projects.insert(folder.clone(), Project::read(folder.clone())?);
        }
        let project = &self.projects[&folder];
        let mut layers = project.file.layers(&project.path_of(&absolute), self.profile.as_deref())?;
        let resolved = read_meta(model).and_then(|meta| {
            layers.extend(meta);
            layers.extend(self.top.iter().cloned());
            resolve(layers)
        });
        let backend = project.file.project.backend.unwrap_or_default();
        Ok(ModelSettings { resolved, cache: project.cache(), backend })
    }
}

impl Project {
    fn read(folder: Option<PathBuf>) -> Result<Self, UsageError> {
        let Some(folder) = folder else { return Ok(Self::default()) };
        let path = folder.join(ProjectFile::PATH);
        let file = shown(&path);
        let file = match read_text(&path) {
            Ok(text) => ProjectFile::parse(&text, &file)?,
            Err(e) if e.kind() == io::ErrorKind::NotFound => ProjectFile::default(),
            Err(e) => return Err(UsageError(format!("cannot read {file}: {e}"))),
        };
        Ok(Self { folder: Some(folder), file })
    }

    /// The path that rules match: the one below `assets/`, as in a game; else the one below the project's folder; else
    /// the name of the file.
    fn path_of(&self, model: &Path) -> String {
        let below = self
            .folder
            .as_deref()
            .and_then(|folder| model.strip_prefix(folder.join("assets")).or_else(|_| model.strip_prefix(folder)).ok());
        slashed(below.unwrap_or(model.file_name().map(Path::new).unwrap_or(model)))
    }

    fn cache(&self) -> ProjectCache {
        ProjectCache { settings: self.file.project.cache.clone(), base: self.folder.clone().unwrap_or_default() }
    }
}

fn existing_folder(dir: &Path) -> Result<PathBuf, UsageError> {
    match dir.canonicalize() {
        Ok(path) if path.is_dir() => Ok(path),
        _ => Err(UsageError(format!("--project {}: there is no such folder", dir.display()))),
    }
}

/// The nearest folder above a model that has a project's file.
pub(crate) fn nearest_project(model: &Path) -> Option<PathBuf> {
    model.ancestors().skip(1).find(|folder| folder.join(ProjectFile::PATH).is_file()).map(Path::to_owned)
}

/// The layer of `<file>.meta`, if the file exists and is for this program.
fn read_meta(model: &Path) -> Result<Option<Layer>, Error> {
    let mut path = OsString::from(model);
    path.push(".meta");
    let file = shown(Path::new(&path));
    let text = match read_text(Path::new(&path)) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::Settings(format!("cannot read {file}: {e}"))),
    };
    let overrides = parse_meta(&text, &file)?;
    Ok(overrides.map(|overrides| Layer { origin: Origin::Meta { file }, overrides }))
}
