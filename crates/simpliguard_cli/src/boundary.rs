//! The folders that links may lead to.
//!
//! Models come from anywhere, and a symbolic link among them may lead anywhere. What lies outside of the folder that the
//! user named, and of its project, is not read.

use std::path::{Path, PathBuf};

/// Some folders and everything below them.
#[derive(Debug)]
pub(crate) struct Boundary(Vec<PathBuf>);

impl Boundary {
    /// A folder and the project around it.
    pub(crate) fn of(folder: &Path, project: Option<&Path>) -> Self {
        let mut boundary = Self(Vec::new());
        boundary.extend([Some(folder), project].into_iter().flatten());
        boundary
    }

    /// Adds folders. One that does not exist holds nothing.
    pub(crate) fn extend<'a>(&mut self, folders: impl IntoIterator<Item = &'a Path>) {
        // The current folder has an empty path when it is a parent.
        let real = |folder: &Path| Path::new(".").join(folder).canonicalize().ok();
        self.0.extend(folders.into_iter().filter_map(real));
    }

    /// Tells whether a canonical path lies inside.
    pub(crate) fn holds(&self, path: &Path) -> bool {
        self.0.iter().any(|folder| path.starts_with(folder))
    }
}
