//! What the page says of the kinds of objects of a scene.

use std::cmp::Reverse;

use serde::Serialize;
use simpliguard::{LevelReport, ObjectReport};

use crate::levels::{Kind, Level};

/// Objects that share their levels.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct ObjectKind {
    pub(super) name: String,
    pub(super) instances: u64,
    /// Triangles of one instance of the source. `None` if they are not known.
    pub(super) triangles: Option<u64>,
    /// The smallest first. Empty for objects that are small enough as they are.
    pub(super) levels: Vec<ObjectLevel>,
}

/// A level of objects.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct ObjectLevel {
    /// Its number, from 1, the smallest.
    pub(super) level: u64,
    pub(super) triangles: Option<u64>,
    /// Distance that 95 % of both surfaces stay within, as a fraction of the diagonal of the object's bounding box.
    pub(super) deviation: Option<f64>,
    /// PSNR in dB of the bake's own pictures of the object. `None` without a report.
    pub(super) psnr: Option<f64>,
    /// What is wrong, in words, if the level hardly looks like its source.
    pub(super) warning: Option<String>,
}

/// The kinds of objects of a bake, with its reports; of a file that came with its levels, the kinds that the file holds. Those
/// with the most triangles in the scene come first.
pub(super) fn objects(reports: Vec<ObjectReport>, kinds: Vec<Kind>) -> Vec<ObjectKind> {
    if reports.is_empty() {
        return kinds.into_iter().map(ObjectKind::from).collect();
    }
    let mut objects: Vec<ObjectKind> = reports.into_iter().map(ObjectKind::from).collect();
    objects.sort_by_key(|kind| Reverse(kind.instances * kind.triangles.unwrap_or(0)));
    objects
}

impl From<ObjectReport> for ObjectKind {
    fn from(ObjectReport { name, instances, source_faces, levels, own_levels }: ObjectReport) -> Self {
        let mut levels: Vec<ObjectLevel> = levels.into_iter().map(ObjectLevel::from).collect();
        // Those that the object came with follow, the smallest first.
        for own in own_levels.into_iter().rev() {
            let level = levels.len() as u64 + 1;
            let (triangles, deviation) = (Some(own.faces), Some(own.error.into()));
            levels.push(ObjectLevel { level, triangles, deviation, psnr: None, warning: None });
        }
        Self { name, instances: instances.into(), triangles: Some(source_faces), levels }
    }
}

impl From<Kind> for ObjectKind {
    fn from(Kind { name, instances, triangles, levels, .. }: Kind) -> Self {
        let levels = levels.into_iter().map(ObjectLevel::from).collect();
        Self { name, instances: instances as u64, triangles, levels }
    }
}

impl From<LevelReport> for ObjectLevel {
    fn from(LevelReport { level, faces, error, likeness, warning, .. }: LevelReport) -> Self {
        Self {
            level: level.into(),
            triangles: Some(faces.into()),
            deviation: Some(error.into()),
            psnr: likeness.map(|likeness| likeness.psnr.into()),
            warning,
        }
    }
}

impl From<Level> for ObjectLevel {
    fn from(Level { level, faces, error, .. }: Level) -> Self {
        Self { level, triangles: faces, deviation: error, psnr: None, warning: None }
    }
}
