//! The report of a bake.

use serde::{Deserialize, Serialize};

use crate::data::{Deviation, Model, TriMesh};
use crate::geometry::{Topology, self_intersecting};
use crate::gltf::SCENE_HINT;
use crate::refine::Refined;
use crate::render::decibels;

/// The outcome for a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It has levels now.
    Baked,
    /// Every budget is at least the source's own face count: it passes through.
    SmallEnough,
    /// It holds no triangles, or its settings switch baking off: it passes through.
    PassThrough,
    /// It came with levels of its own, which are kept.
    KeptLods,
}

/// The report of one file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The outcome.
    pub status: Status,
    /// Triangles of the source's default scene.
    pub source_faces: u64,
    /// One entry per level, budgets ascending.
    pub levels: Vec<LevelReport>,
    /// One entry per kind of object that was baked, with `scope: Objects`. `levels` is empty then.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub objects: Vec<ObjectReport>,
    /// Things that were left out or need attention, in words.
    pub notes: Vec<String>,
    /// Seconds per stage, summed over levels that ran beside each other.
    pub seconds: StageSeconds,
}

impl Report {
    /// The levels of the file, and those of its objects.
    pub fn all_levels(&self) -> impl Iterator<Item = &LevelReport> {
        self.levels.iter().chain(self.objects.iter().flat_map(|object| &object.levels))
    }

    /// The note on a file that looks like a scene of many objects, and was baked as one.
    pub fn scene_hint(&self) -> Option<&str> {
        self.notes.iter().find(|note| note.starts_with(SCENE_HINT)).map(String::as_str)
    }

    /// The GPU on which levels were refined, if any was.
    pub fn device(&self) -> Option<&str> {
        self.all_levels().find_map(|level| level.device.as_deref())
    }

    /// The report of a file that has levels now. `morphs` tells whether morph targets are transferred.
    pub(super) fn baked(
        model: &Model,
        levels: Vec<LevelReport>,
        unmet: Vec<String>,
        morphs: bool,
        seconds: StageSeconds,
    ) -> Self {
        let source_faces = model.surface.triangles.len() as u64;
        let unlike = levels.iter().filter_map(|level| level.warning.clone());
        let notes =
            model.notes.iter().cloned().chain(dropped_morphs(model, morphs)).chain(unmet).chain(unlike).collect();
        Self { status: Status::Baked, source_faces, levels, objects: Vec::new(), notes, seconds }
    }

    /// The report of a file that passes through.
    pub(super) fn passed_through(status: Status, model: Option<&Model>, seconds: StageSeconds) -> Self {
        let source_faces = model.map_or(0, |model| model.surface.triangles.len() as u64);
        let notes = model.map(|model| model.notes.clone()).unwrap_or_default();
        Self { status, source_faces, levels: Vec::new(), objects: Vec::new(), notes, seconds }
    }
}

/// The report of equal objects of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectReport {
    /// The name of the first instance.
    pub name: String,
    /// Number of instances.
    pub instances: u32,
    /// Triangles of one instance.
    pub source_faces: u64,
    /// One entry per level, budgets ascending. Empty if the object passes through.
    pub levels: Vec<LevelReport>,
    /// The levels that the object came with and keeps, in falling detail. Their numbers follow those of `levels`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub own_levels: Vec<OwnLevelReport>,
}

impl ObjectReport {
    /// True if the object has levels, baked ones or its own.
    pub fn has_levels(&self) -> bool {
        !self.levels.is_empty() || !self.own_levels.is_empty()
    }
}

/// A level that an object came with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OwnLevelReport {
    /// Its triangles.
    pub faces: u64,
    /// Distance that 95 % of both surfaces, the object's and its own, stay within, as a fraction of the diagonal of the
    /// object's bounding box.
    pub error: f32,
}

/// A note on morph targets that levels leave out.
fn dropped_morphs(model: &Model, transferred: bool) -> Option<String> {
    let morphs = model.surface.morphs.as_ref().filter(|_| !transferred)?;
    let count = morphs.targets.len();
    Some(format!("{count} morph targets stay at their default weights in the levels: `morph_targets` is Drop"))
}

/// Seconds by stage name, in the order of the stages.
pub type StageSeconds = Vec<(String, f64)>;

/// The report of one level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelReport {
    /// Counted from 1, the smallest.
    pub level: u32,
    /// Most faces allowed.
    pub budget: u32,
    /// Faces reached.
    pub faces: u32,
    /// The reason for fewer faces than 98 % of the budget.
    pub stopped: Option<String>,
    /// The candidate that won.
    pub candidate: String,
    /// Distance to the source that 95 % of both surfaces stay within, as a fraction of the bounding box's diagonal.
    pub error: f32,
    /// Distances in full.
    pub deviation: Deviation,
    /// Topology of its surface.
    pub topology: LevelTopology,
    /// Charts of the atlas.
    pub charts: u32,
    /// Fraction of the atlas that charts cover.
    pub fill: f32,
    /// L2 stretch of the atlas (Sander et al. 2001) relative to each chart's mean texel density: 1 if lengths are kept.
    pub stretch: f32,
    /// L-infinity stretch: the largest length of a texel on the surface, relative to the mean density of its chart.
    pub worst_stretch: f32,
    /// Its clear layers, such as glass. Their faces are part of `faces`.
    #[serde(default)]
    pub clear: Vec<ClearReport>,
    /// Cut-out cards that stand for lattices, of two faces each. They are part of `faces`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lattices: u32,
    /// Gain of the refinement, in dB over held-out views; `None` without refinement.
    pub refined: Option<Refined>,
    /// The GPU that moved its vertices, or fitted its texture; `None` for the CPU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// How much it looks like the source; `None` in a preview.
    pub likeness: Option<Likeness>,
    /// What is wrong, in words, if the likeness is below `warn_below`, or if the level misses one of its bars. It is also
    /// among the report's notes.
    pub warning: Option<String>,
}

/// How much a level looks like its source: means over views on black and on white.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Likeness {
    /// PSNR in dB over the pixels that the level or the source touches, without light.
    pub psnr: f32,
    /// The same under a light at the camera.
    pub psnr_lit: f32,
    /// PSNR in dB of the view with the largest error, without and with light. A mean of views may hide it.
    #[serde(default)]
    pub psnr_worst: f32,
    /// Intersection over union of the silhouettes, 0 to 1.
    pub silhouette_iou: f32,
    /// The material of the source with the most wrong pixels, if any are wrong.
    pub worst: Option<WrongMaterial>,
}

/// A material of the source that a level shows wrongly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WrongMaterial {
    /// Its name, or its number if it has none.
    pub material: String,
    /// Fraction of its pixels that are wrong, 0 to 1.
    pub wrong: f32,
}

impl LevelReport {
    /// How much the level looks like its source, in dB; 0 if nobody has looked.
    pub(super) fn mean_psnr(&self) -> f32 {
        self.likeness.as_ref().map_or(0.0, Likeness::mean_psnr)
    }

    /// How much the view of the largest error looks like the source, in dB; 0 if nobody has looked.
    pub(super) fn worst_psnr(&self) -> f32 {
        self.likeness.as_ref().map_or(0.0, |likeness| likeness.psnr_worst)
    }

    /// The fraction of the pixels that are wrong of the material that carries most of the error; 0 if nobody has looked.
    pub(super) fn wrong_share(&self) -> f32 {
        let worst = self.likeness.as_ref().and_then(|likeness| likeness.worst.as_ref());
        worst.map_or(0.0, |worst| worst.wrong)
    }
}

impl Likeness {
    /// PSNR in dB of the mean error without and with light: what only one of them shows is wrong all the same.
    fn mean_psnr(&self) -> f32 {
        let error = |psnr: f32| libm::exp10(-0.1 * f64::from(psnr));
        decibels(0.5 * (error(self.psnr) + error(self.psnr_lit))) as f32
    }

    /// What is wrong, in words, for a level of this number whose PSNR is below `bar`.
    pub(super) fn warning(&self, level: u32, bar: f32) -> Option<String> {
        if self.psnr >= bar {
            return None;
        }
        let Self { psnr, silhouette_iou, worst, .. } = self;
        let overlap = 100.0 * silhouette_iou;
        let worst = worst.as_ref().map_or_else(String::new, |WrongMaterial { material, wrong }| {
            format!(", and {:.0} % of the pixels of material '{material}' are wrong", 100.0 * wrong)
        });
        Some(format!(
            "LOD{level} hardly looks like its source: {psnr:.1} dB, below `warn_below` ({bar:.1}); the silhouettes overlap \
             by {overlap:.0} %{worst}"
        ))
    }
}

/// True for a number that says nothing.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
fn is_zero(n: &u32) -> bool {
    *n == 0
}

/// The report of a clear layer of a level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClearReport {
    /// Number of faces.
    pub faces: u32,
    /// Mean alpha of its texels, 0 clear to 1.
    pub alpha: f32,
    /// Light passes through by `KHR_materials_transmission`.
    pub transmits: bool,
}

/// Topology of a level's surface, before vertices are split along charts. All levels are manifolds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LevelTopology {
    /// Edge-connected components.
    pub components: u32,
    /// Vertices less edges plus faces: two for each closed component, less two for each handle and one for each hole.
    pub euler_characteristic: i64,
    /// Edges of one face: the boundary of sheets, and of holes where nothing sees them.
    pub boundary_edges: u32,
    /// Self-intersecting faces.
    pub self_intersecting: u32,
}

impl LevelTopology {
    /// Measures a level.
    pub fn of(mesh: &TriMesh) -> Self {
        let topology = Topology::of(mesh);
        Self {
            components: topology.components as u32,
            euler_characteristic: topology.euler_characteristic,
            boundary_edges: topology.edges.boundary as u32,
            self_intersecting: self_intersecting(mesh).into_iter().filter(|face| *face).count() as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_note_on_a_scene_is_found_among_others() {
        let report = |notes: &[&str]| Report {
            status: Status::Baked,
            source_faces: 0,
            levels: Vec::new(),
            objects: Vec::new(),
            notes: notes.iter().map(|&note| note.to_owned()).collect(),
            seconds: Vec::new(),
        };
        let hint = format!("{SCENE_HINT}20 objects");
        assert_eq!(report(&["another", &hint]).scene_hint(), Some(&hint[..]));
        assert_eq!(report(&["another"]).scene_hint(), None);
        // A note on an object of a scene that is baked object by object.
        assert_eq!(report(&[&format!("hut: {hint}")]).scene_hint(), None);
    }
}
