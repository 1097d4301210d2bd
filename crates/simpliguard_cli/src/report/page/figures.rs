//! The figures of a level, as columns of tables.

use super::text::{bytes, count, percent, three, two};
use crate::report::asset::{Cost, Measured, MeasuredLevel};

/// A column of figures.
pub(super) struct Figure {
    pub(super) title: &'static str,
    /// What it says, for those who point at it.
    pub(super) help: &'static str,
    pub(super) value: Value,
    pub(super) text: fn(f64) -> String,
}

/// The value of a figure.
pub(super) enum Value {
    /// Of the source and of a level.
    Cost(fn(&Cost) -> u64),
    /// Of a level; `None` if it does not exist.
    Level(fn(&MeasuredLevel) -> Option<f64>),
    /// Of the whole model.
    Model(fn(&Measured) -> f64),
}

/// What a level costs.
pub(super) const COSTS: [Figure; 5] = [
    Figure { title: "Triangles", help: "Triangles in the scene", value: Value::Cost(|c| c.triangles), text: count },
    Figure { title: "Draw calls", help: "Primitives in the scene", value: Value::Cost(|c| c.draw_calls), text: count },
    Figure {
        title: "Texture memory",
        help: "Bytes of the textures on the GPU, with mipmaps",
        value: Value::Cost(|c| c.texture_memory),
        text: bytes,
    },
    Figure {
        title: "Mesh memory",
        help: "Bytes of vertices and indices on the GPU",
        value: Value::Cost(|c| c.mesh_memory),
        text: bytes,
    },
    Figure {
        title: "Bytes",
        help: "Vertices, indices and images in the file, geometry not compressed",
        value: Value::Cost(|c| c.bytes),
        text: bytes,
    },
];

/// Seconds of a model.
pub(super) const SECONDS: Figure = Figure {
    title: "Seconds",
    help: "Time of the bake for all levels, or of the look-up in the cache",
    value: Value::Model(|m| m.seconds_total),
    text: two,
};

/// Notes and warnings of a model.
pub(super) const WARNINGS: Figure = Figure {
    title: "Notes",
    help: "Warnings, and what was left out",
    value: Value::Model(|m| m.notes.len() as f64),
    text: count,
};

/// How close a level is, in short.
pub(super) const LIKENESS: [Figure; 4] = [PSNR, LIT, SILHOUETTE, DEVIATION];

/// How close a level is, in full.
pub(super) const ALL_LIKENESS: [Figure; 11] = [
    PSNR,
    Figure {
        title: "Foreground",
        help: "PSNR in dB over the pixels that the source or the level touches",
        value: Value::Level(|l| Some(l.comparison.unlit.psnr_foreground)),
        text: two,
    },
    LIT,
    Figure {
        title: "SSIM",
        help: "Structural similarity without light, at most 1",
        value: Value::Level(|l| Some(l.comparison.unlit.ssim)),
        text: three,
    },
    Figure {
        title: "FLIP",
        help: "Difference that a viewer sees who flips between the pictures, 0 to 1",
        value: Value::Level(|l| Some(l.comparison.unlit.flip)),
        text: three,
    },
    Figure {
        title: "NLPIPS",
        help: "One less LPIPS relative to that of noise, without light, at most 1. None without --lpips-weights",
        value: Value::Level(|l| l.comparison.perceptual.map(|perceptual| perceptual.nlpips)),
        text: three,
    },
    SILHOUETTE,
    DEVIATION,
    Figure {
        title: "Chamfer %",
        help: "Mean distance between the surfaces, of the diagonal of the source's bounding box",
        value: Value::Level(|l| l.comparison.distances.map(|d| d.chamfer)),
        text: percent,
    },
    Figure {
        title: "Hausdorff %",
        help: "Largest distance between the surfaces, of the same diagonal",
        value: Value::Level(|l| l.comparison.distances.map(|d| d.hausdorff)),
        text: percent,
    },
    Figure {
        title: "Charts",
        help: "Charts of the texture atlas",
        value: Value::Level(|l| l.report.as_ref().map(|report| f64::from(report.charts))),
        text: count,
    },
];

const PSNR: Figure = Figure {
    title: "PSNR",
    help: "Mean PSNR over the views on white, without light, in dB. None for a white model, of which such pictures say nothing",
    value: Value::Level(MeasuredLevel::psnr),
    text: two,
};

const LIT: Figure = Figure {
    title: "PSNR lit",
    help: "The same under a lamp at the camera",
    value: Value::Level(|l| Some(l.comparison.lit.psnr)),
    text: two,
};

const SILHOUETTE: Figure = Figure {
    title: "Silhouette %",
    help: "Intersection over union of the silhouettes",
    value: Value::Level(|l| Some(l.comparison.silhouette_iou)),
    text: percent,
};

const DEVIATION: Figure = Figure {
    title: "Deviation %",
    help: "Distance that 95 % of both surfaces stay within, of the diagonal of the source's bounding box",
    value: Value::Level(|l| l.deviation),
    text: percent,
};

impl Figure {
    /// Its value for a level, and the source's if it has one.
    pub(super) fn of(&self, model: &Measured, level: &MeasuredLevel) -> (Option<f64>, Option<f64>) {
        match self.value {
            Value::Cost(cost) => (Some(cost(&level.cost) as f64), Some(cost(&model.source) as f64)),
            Value::Level(value) => (value(level), None),
            Value::Model(value) => (Some(value(model)), None),
        }
    }

    /// A value as text, or a dash.
    pub(super) fn text_of(&self, value: Option<f64>) -> String {
        value.map_or_else(|| "–".to_owned(), self.text)
    }
}

/// The mean; `None` of no values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0, 0.0), |(count, sum), value| (count + 1, sum + value));
    (count > 0).then(|| sum / f64::from(count))
}
