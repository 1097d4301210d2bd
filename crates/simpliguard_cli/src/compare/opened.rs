//! A file of a comparison.

use std::borrow::Cow;
use std::path::Path;

use simpliguard::Error;
use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import};

use super::rows::Subject;
use crate::levels::{Instances, Level, Levels, Part};
use crate::project::nearest_project;
use crate::source::SourceFile;

/// A file, and the levels that it holds.
pub(super) struct Opened {
    pub(super) file: String,
    pub(super) model: Model,
    pub(super) levels: Levels,
}

impl Opened {
    /// Reads a file with all that it refers to.
    ///
    /// # Errors
    /// Those of the import.
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let file = path.display().to_string();
        let project = path.canonicalize().ok().and_then(|path| nearest_project(&path));
        let source = SourceFile::read(path, &file, project.as_deref())?;
        let model = import(&source.source(), &ImportLimits::default())?;
        let levels = Levels::of(&model.document.json);
        Ok(Self { file, model, levels })
    }

    /// The levels of the whole file; if it has none, the file is a level itself.
    ///
    /// # Errors
    /// Those of the import.
    pub(super) fn candidates(&self) -> Result<Vec<(Subject, Cow<'_, Model>)>, Error> {
        let subject = |level: Option<&Level>| Subject {
            file: self.file.clone(),
            name: level.map(|level| level.name.clone()),
            level: level.map(|level| level.level),
            object: None,
        };
        if self.levels.all.is_empty() {
            return Ok(vec![(subject(None), Cow::Borrowed(&self.model))]);
        }
        let candidate = |level: &Level| {
            let part = self.part(&level.nodes, Instances::All).import(&format!("{}, {}", self.file, level.name))?;
            Ok((subject(Some(level)), Cow::Owned(part)))
        };
        self.levels.all.iter().map(candidate).collect()
    }

    /// Some of its nodes.
    pub(super) fn part<'a>(&'a self, nodes: &'a [usize], drawn: Instances) -> Part<'a> {
        Part { document: &self.model.document, nodes, drawn }
    }
}
