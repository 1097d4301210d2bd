//! Patterns of node names.

use globset::GlobMatcher;
use serde::{Deserialize, Serialize};

use super::glob::compile_glob;

/// A glob over the names of nodes, `Lamp*`; upper and lower case differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct NodePattern(pub String);

impl NodePattern {
    /// Matches names of nodes; `None` if the glob is malformed.
    pub fn matcher(&self) -> Option<GlobMatcher> {
        compile_glob(&self.0, |_| {}).ok()
    }
}
