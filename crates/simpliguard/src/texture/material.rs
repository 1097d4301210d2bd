//! The factors of a level's material.

use glam::{Vec3, Vec4};

use crate::data::{AlphaMode, LevelMaterial};
use crate::render::SurfaceSample;

/// Largest difference of a channel that counts as constant: one and a half steps of eight bits.
const CONSTANT: f32 = 1.5 / 255.0;
/// Largest difference of a linear colour that counts as constant: below half a step of eight bits in the dark, too.
const SAME_COLOR: f32 = 1e-4;
/// Emission up to which a level counts as dark: one step of eight bits.
const DARK: f32 = 1.0 / 255.0;

/// Means and ranges of a level's samples: what its material needs an image for, and the factors besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialStatistics {
    /// Occlusion, roughness or metalness varies over the level.
    pub rough_metal: bool,
    /// Mean roughness, 0 to 1.
    pub roughness: f32,
    /// Mean metalness, 0 to 1.
    pub metallic: f32,
    /// Brightest emission of each channel, linear; zero in channels that are dark everywhere, unless another channel is
    /// not. One if anything glows.
    pub emissive: Vec3,
    /// Something does nothing but emit light.
    pub glows: bool,
    /// Linear colour and alpha, if they are the same everywhere and nothing glows.
    pub base_color: Option<Vec4>,
}

impl MaterialStatistics {
    /// The statistics of samples. Without `alpha`, everything is opaque.
    pub(super) fn of(samples: &[Option<SurfaceSample>], alpha: bool) -> Self {
        let (mut low, mut high, mut sum, mut count) = (Vec3::MAX, Vec3::MIN, Vec3::ZERO, 0.0);
        let mut emissive = Vec3::ZERO;
        for s in samples.iter().flatten().filter(|sample| sample.is_seen()) {
            let v = Vec3::new(s.occlusion, s.roughness, s.metallic);
            (low, high, sum, count) = (low.min(v), high.max(v), sum + v, count + 1.0);
            emissive = emissive.max(s.emissive);
        }
        let mean = if count > 0.0 { sum / count } else { Vec3::new(1.0, 1.0, 0.0) };
        let glows = samples.iter().flatten().any(|s| s.glows);
        let emissive = match emissive.max_element() > DARK {
            _ if glows => emissive.max(Vec3::ONE),
            true => emissive.max(Vec3::splat(1e-3)),
            false => Vec3::ZERO,
        };
        Self {
            rough_metal: (high - low).max_element() > CONSTANT,
            roughness: mean.y,
            metallic: mean.z,
            emissive,
            glows,
            base_color: if glows { None } else { constant_color(samples, alpha) },
        }
    }
}

/// The colour of all samples, if there is one.
fn constant_color(samples: &[Option<SurfaceSample>], alpha: bool) -> Option<Vec4> {
    let mut colors = samples.iter().flatten().map(|s| if alpha { s.color } else { s.color.with_w(1.0) });
    let first = colors.next()?;
    colors.all(|color| (color - first).abs().max_element() <= SAME_COLOR).then_some(first)
}

/// The factors of a level's material.
pub fn level_material(
    statistics: &MaterialStatistics,
    alpha_mode: AlphaMode,
    double_sided: bool,
    unlit: bool,
) -> LevelMaterial {
    LevelMaterial {
        alpha_mode,
        double_sided,
        unlit,
        metallic: statistics.metallic,
        roughness: statistics.roughness,
        emissive: statistics.emissive,
        base_color: statistics.base_color.unwrap_or(Vec4::ONE),
        transmission: None,
    }
}
