//! Comparison in motion: frames of the source's clips.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use simpliguard::animation::LinearBlend;
use simpliguard::data::{Model, Pose};
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Light, Renderer, SurfaceSampler};

use super::image::Pair;
use super::views::{SAMPLES, SIZE, cameras, mean};

/// Views of each frame.
const VIEWS: usize = 20;
/// Frames at times that differ by less, in seconds, are the same.
const SAME_TIME: f32 = 1e-3;

/// Means over frames of the clips, unlit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MotionMetrics {
    /// Number of frames.
    pub frames: usize,
    /// PSNR in dB.
    pub psnr: f64,
    /// PSNR in dB over the pixels that the source or the level touches.
    pub psnr_foreground: f64,
    /// Intersection over union of the silhouettes.
    pub silhouette_iou: f64,
    /// Loss of foreground PSNR in the worst frame against the rest pose, in dB.
    pub worst_drop: f64,
}

/// PSNR, foreground PSNR and silhouette IoU of one frame.
type Frame = [f64; 3];

/// Compares a level with its source in frames of the clips that both have. `None` if there are none.
pub(crate) fn motion(source: &Model, level: &Model) -> Option<MotionMetrics> {
    let models = [source, level];
    let [of_source, of_level] = models.map(LinearBlend::of);
    let (of_source, of_level) = (of_source?, of_level?);
    let frames: Vec<[&Pose; 2]> =
        of_source.poses().iter().filter_map(|pose| Some([pose, same_frame(pose, of_level.poses())?])).collect();
    if frames.is_empty() {
        return None;
    }
    let samplers = models.map(SurfaceSampler::new);
    let rest = models.map(|model| model.surface.positions.clone());
    let rest = frame(&samplers, &rest);
    let posed = frames.iter().map(|poses| {
        let blends = [&of_source, &of_level];
        frame(&samplers, &[0, 1].map(|i| positions(models[i], blends[i], poses[i])))
    });
    let posed: Vec<Frame> = posed.collect();
    let of = |k: usize| mean(posed.iter().map(|frame| frame[k]));
    let worst_drop = posed.iter().map(|frame| rest[1] - frame[1]).fold(f64::MIN, f64::max);
    Some(MotionMetrics { frames: posed.len(), psnr: of(0), psnr_foreground: of(1), silhouette_iou: of(2), worst_drop })
}

/// The pose among `all` at the same moment of the same clip.
fn same_frame<'p>(pose: &Pose, all: &'p [Pose]) -> Option<&'p Pose> {
    let (clip, time) = pose.frame?;
    all.iter().find(|other| other.frame.is_some_and(|(c, t)| c == clip && (t - time).abs() < SAME_TIME))
}

fn positions(model: &Model, blend: &LinearBlend<'_>, pose: &Pose) -> Vec<Vec3> {
    let motions = blend.motions(&blend.bones(pose), &model.surface.influences);
    model.surface.positions.iter().zip(motions).map(|(p, motion)| motion.transform_point3(*p)).collect()
}

/// Means over views that are framed on the source.
fn frame(samplers: &[SurfaceSampler<'_>; 2], positions: &[Vec<Vec3>; 2]) -> Frame {
    let cameras = cameras(&BoundingSphere::around(&positions[0]), VIEWS);
    let renderers = || samplers.each_ref().map(|sampler| Renderer::new(sampler, SIZE, SAMPLES));
    let view = |renderers: &mut [Renderer<'_>; 2], camera: &Camera| {
        let [[a], [b]] = [0, 1].map(|i| renderers[i].draw_moved(&positions[i], camera, [Light::None]));
        let pair = Pair::new(&a, &b);
        [pair.psnr(), pair.psnr_foreground(), pair.silhouette_iou()]
    };
    let views: Vec<Frame> = cameras.par_iter().map_init(renderers, view).collect();
    [0, 1, 2].map(|k| mean(views.iter().map(|view| view[k])))
}
