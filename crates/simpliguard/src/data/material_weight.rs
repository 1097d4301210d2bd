//! Weights of materials.

use globset::GlobMatcher;
use serde::{Deserialize, Serialize};

use super::glob::compile_glob;

/// Weight of the faces of some materials, relative to all others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialWeight {
    /// Glob over the names of materials, `*Face*`; upper and lower case differ.
    pub material: String,
    /// Factor on the weight of the faces, both in the collapse and in the selection of candidates.
    pub weight: f32,
}

impl MaterialWeight {
    /// Matches names of materials; `None` if the glob is malformed.
    pub fn matcher(&self) -> Option<GlobMatcher> {
        compile_glob(&self.material, |_| {}).ok()
    }
}
