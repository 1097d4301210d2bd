//! What the page says of one model.

use serde::Serialize;
use simpliguard::data::Model;
use simpliguard::geometry::BoundingSphere;
use simpliguard::gltf::{GpuCost, ImportLimits, gpu_cost_besides, import};
use simpliguard::{Error, LevelReport, NoResources, Source, Status};
use simpliguard_bake::Outcome;
use simpliguard_eval::compare::{Comparison, Options, compare};
use simpliguard_eval::{jpeg, pictures};

use super::objects::{ObjectKind, objects};
use super::preview::{Made, Preview, preview};
use crate::inspect::document::Document;
use crate::levels::{Instances, Level, Levels, Of, Part};
use crate::plan::Job;
use crate::source::SourceFile;

/// Quality of the pictures as JPEG.
const QUALITY: u8 = 85;
/// PSNR of pictures that are alike, in dB.
const ALIKE: f64 = 100.0;

/// What a level stands for, and its number.
pub(super) type LevelKey = (Of, u64);

/// A model of the page.
pub(super) struct Asset {
    /// Path of the model as it was found.
    pub(super) name: String,
    /// The name without the folder that all models of the page share.
    pub(super) label: String,
    /// `Err` with the cause if there is no result.
    pub(super) result: Result<Measured, String>,
}

/// Bytes of the folder that all paths share, with the separator behind it.
pub(super) fn shared_folder(paths: &[&str]) -> usize {
    let Some(first) = paths.first() else { return 0 };
    let same = |path: &&str| first.bytes().zip(path.bytes()).take_while(|(a, b)| a == b).count();
    let length = paths.iter().map(same).min().unwrap_or(0);
    first.bytes().take(length).rposition(|byte| matches!(byte, b'/' | b'\\')).map_or(0, |at| at + 1)
}

/// The figures and pictures of a model.
#[derive(Serialize)]
pub(super) struct Measured {
    pub(super) status: Status,
    /// True if the cache had the result.
    pub(super) cached: bool,
    /// Seconds until the result was there: those of its bake, or of the look-up.
    pub(super) seconds_total: f64,
    /// Seconds of each stage, in the order of the stages. Empty if nothing was baked.
    pub(super) seconds: Vec<(String, f64)>,
    pub(super) notes: Vec<String>,
    pub(super) settings: Vec<Setting>,
    /// Bytes of the model's file, without those that it refers to.
    pub(super) file_bytes: u64,
    pub(super) source: Cost,
    /// The smallest first.
    pub(super) levels: Vec<MeasuredLevel>,
    /// The kinds of objects of a scene with levels for each object.
    pub(super) objects: Vec<ObjectKind>,
    /// What the models of the 3-D view are made of; `None` if there are none.
    pub(super) preview: Option<Made>,
    #[serde(skip)]
    pub(super) models: Option<Vec<u8>>,
    /// Sheets as JPEG by their names; empty without levels.
    #[serde(skip)]
    pub(super) sheets: Vec<Sheet>,
}

/// A sheet of pictures: the source, then the levels from the most triangles to the fewest.
pub(super) struct Sheet {
    pub(super) name: &'static str,
    pub(super) jpeg: Vec<u8>,
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
}

/// What a source or a level costs a game.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Cost {
    pub(super) triangles: u64,
    /// Primitives in the scene.
    pub(super) draw_calls: u64,
    /// Bytes in memory of its textures, with mipmaps.
    pub(super) texture_memory: u64,
    /// Bytes in memory of its vertices and indices.
    pub(super) mesh_memory: u64,
    /// Bytes of its vertices, indices and images in the file, without compression of geometry.
    pub(super) bytes: u64,
}

/// A level with its figures.
#[derive(Serialize)]
pub(super) struct MeasuredLevel {
    /// `LOD1`, or what it stands for besides.
    pub(super) name: String,
    /// What it stands for.
    #[serde(skip)]
    pub(super) of: Of,
    /// Its number, from 1, the smallest.
    pub(super) level: u64,
    /// Distance that 95 % of both surfaces stay within, as a fraction of the diagonal of the source's bounding box. `None`
    /// if the file does not say it.
    pub(super) deviation: Option<f64>,
    /// The report of its bake. `None` for the levels that a file came with.
    pub(super) report: Option<LevelReport>,
    pub(super) cost: Cost,
    pub(super) comparison: Comparison,
}

/// A setting that the model was baked with.
#[derive(Serialize)]
pub(super) struct Setting {
    pub(super) name: &'static str,
    pub(super) value: String,
    pub(super) origin: String,
}

impl Measured {
    /// Measures a result as the options say. Its 3-D view takes about `share` bytes less those of its pictures.
    ///
    /// # Errors
    /// Those of the import.
    pub(super) fn new(
        job: &Job,
        file: &SourceFile,
        outcome: Outcome,
        seconds_total: f64,
        (options, share): (&Options<'_>, u64),
    ) -> Result<Self, Error> {
        let (result, cached) = (outcome.result, outcome.is_cached);
        let read = |bytes| {
            let source = Source { name: &job.name, bytes, resources: &NoResources };
            import(&source, &ImportLimits::default())
        };
        let model = read(&result.combined)?;
        let levels = Levels::of(&model.document.json);
        let part = |level: &Level| {
            let part = Part { document: &model.document, nodes: &level.nodes, drawn: Instances::All };
            part.import(&format!("{}, {}", job.name, level.name))
        };
        let models: Vec<Model> = levels.all.iter().map(part).collect::<Result<_, _>>()?;
        let models: Vec<&Model> = models.iter().collect();
        let shown = levels.source_of(&model)?;
        let sheets = sheets(&shown, &models);
        let compared = compare(&shown, &models, options);
        let document = Document::new(&model);
        let pictures: usize = sheets.iter().map(|sheet| sheet.jpeg.len()).sum();
        let left = usize::try_from(share).unwrap_or(usize::MAX).saturating_sub(pictures);
        let radius = BoundingSphere::around(&shown.surface.positions).radius;
        let preview = preview(&model.document, &levels, radius, left);
        let cost = |nodes: &[usize], triangles: usize, others: &[usize]| {
            let gpu = gpu_cost_besides(&model.document, nodes.iter().copied(), others.iter().copied());
            Cost::new(triangles, document.bytes_of_nodes(nodes), gpu)
        };
        let report = |level: &Level| result.report.levels.iter().find(|report| u64::from(report.level) == level.level);
        let measured = |(level, comparison): (&Level, Comparison)| MeasuredLevel {
            name: level.name.clone(),
            of: level.of,
            level: level.level,
            deviation: level.error,
            report: report(level).filter(|_| level.of != Of::Objects).cloned(),
            cost: cost(&level.nodes, comparison.faces, &levels.source),
            comparison,
        };
        let source = cost(&levels.source, shown.surface.triangles.len(), &[]);
        let mut seconds: Vec<(String, f64)> = Vec::new();
        for (stage, time) in result.report.seconds {
            match seconds.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, sum)) => *sum += time,
                None => seconds.push((stage, time)),
            }
        }
        Ok(Self {
            status: result.report.status,
            cached,
            seconds_total,
            seconds,
            notes: result.report.notes,
            settings: settings(job),
            file_bytes: file.source().bytes.len() as u64,
            source,
            levels: levels.all.iter().zip(compared).map(measured).collect(),
            objects: objects(result.report.objects, levels.kinds),
            preview: preview.as_ref().map(|preview| preview.made),
            models: preview.map(|Preview { glb, .. }| glb),
            sheets,
        })
    }

    /// The level with a key.
    pub(super) fn level(&self, key: LevelKey) -> Option<&MeasuredLevel> {
        self.levels.iter().find(|level| level.key() == key)
    }

    /// Bytes that go into the page as base64.
    pub(super) fn bytes(&self) -> u64 {
        let sheets = self.sheets.iter().map(|sheet| sheet.jpeg.len());
        sheets.chain(self.models.as_ref().map(Vec::len)).sum::<usize>() as u64
    }

    /// The outcome in words.
    pub(super) fn status_text(&self) -> &'static str {
        match self.status {
            Status::Baked if self.cached => "from the cache",
            Status::Baked => "baked",
            Status::SmallEnough => "small enough",
            Status::PassThrough => "passed through",
            Status::KeptLods => "with levels of its own",
        }
    }

    /// The likeness that models are ranked by: the smallest PSNR of a level, unlit; lit where the unlit pictures say nothing.
    /// `None` without levels.
    pub(super) fn worst_psnr(&self) -> Option<f64> {
        let psnr = |level: &MeasuredLevel| level.psnr().unwrap_or(level.comparison.lit.psnr);
        self.levels.iter().map(psnr).reduce(f64::min)
    }
}

impl MeasuredLevel {
    /// What it stands for, and its number: levels of several models that have these in common are compared.
    pub(super) fn key(&self) -> LevelKey {
        (self.of, self.level)
    }

    /// PSNR in dB, unlit. `None` for pictures that are all alike, as those of a white model on white: they say nothing.
    pub(super) fn psnr(&self) -> Option<f64> {
        Some(self.comparison.unlit.psnr).filter(|psnr| *psnr < ALIKE)
    }
}

fn settings(job: &Job) -> Vec<Setting> {
    let resolved = job.settings.as_ref().ok();
    let effective = resolved.into_iter().flat_map(|resolved| resolved.effective());
    effective.map(|e| Setting { name: e.name, value: e.value, origin: e.origin.to_string() }).collect()
}

impl Cost {
    fn new(triangles: usize, bytes: u64, gpu: GpuCost) -> Self {
        let GpuCost { draw_calls, mesh_memory, texture_memory } = gpu;
        Self { triangles: triangles as u64, draw_calls, texture_memory, mesh_memory, bytes }
    }
}

/// The sheets of a model. None without levels.
fn sheets(model: &Model, levels: &[&Model]) -> Vec<Sheet> {
    if levels.is_empty() {
        return Vec::new();
    }
    let largest_first: Vec<&Model> = levels.iter().rev().copied().collect();
    let pictures = pictures(model, &largest_first);
    let all = [("unlit", pictures.unlit), ("lit", pictures.lit), ("heat", pictures.heat)];
    let sheet = |(name, image): (&'static str, image::RgbImage)| {
        Some(Sheet { name, jpeg: jpeg(&image, QUALITY)?, size: image.dimensions().into() })
    };
    all.into_iter().filter_map(sheet).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_leave_out_the_folder_that_all_share() {
        assert_eq!(shared_folder(&["a/b/x.glb", "a/b/xy.glb"]), 4);
        assert_eq!(shared_folder(&["a/b/x.glb", "a/c.glb"]), 2);
        assert_eq!(shared_folder(&["a/b/x.glb"]), 4);
        assert_eq!(shared_folder(&["x.glb", "y.glb"]) + shared_folder(&[]), 0);
    }
}
