//! The factors of a level's material.

use glam::Vec3;

use crate::data::{AlphaMode, LevelMaterial};
use crate::render::SurfaceSample;

/// Largest difference of a channel that counts as constant: one and a half steps of eight bits.
const CONSTANT: f32 = 1.5 / 255.0;
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
}

impl MaterialStatistics {
    pub(super) fn of(samples: &[Option<SurfaceSample>]) -> Self {
        let (mut low, mut high, mut sum, mut count) = (Vec3::MAX, Vec3::MIN, Vec3::ZERO, 0.0);
        let mut emissive = Vec3::ZERO;
        for s in samples.iter().flatten() {
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
        }
    }
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
        transmission: None,
    }
}
