//! The texture of a level at one size.

use glam::Vec4;
use rayon::prelude::*;

use super::params::TextureParams;
use super::source::PreparedSource;
use crate::Cancellation;
use crate::data::{Atlas, Cards, TriMesh, linear_to_srgb};
use crate::refine::{TexelGrid, TextureFit};
use crate::render::{Camera, SurfaceSample, View, fill_unknown};
use crate::settings::InitialTexture;
use crate::texture::{BakeTarget, Projection, TexelMap};

/// Encoded grey of a texture that is not made.
const GREY: Vec4 = Vec4::new(0.5, 0.5, 0.5, 1.0);
/// Half a step of eight bits.
const HALF_STEP: f32 = 0.5 / 255.0;

/// The place of a level in a texture.
pub(super) struct LevelTexture<'a> {
    source: &'a PreparedSource<'a>,
    views: &'a [View],
    atlas: &'a Atlas,
    params: TextureParams,
    pub(super) texels: TexelMap,
}

impl<'a> LevelTexture<'a> {
    /// Of a level of `source`, which `views` show, with an atlas of `size` x `size` texels.
    pub(super) fn new(
        source: &'a PreparedSource<'a>,
        views: &'a [View],
        atlas: &'a Atlas,
        params: TextureParams,
        size: usize,
    ) -> Self {
        Self { source, views, atlas, params, texels: TexelMap::new(atlas, size) }
    }

    /// Samples of the source at each texel. Their colours may be those of the views.
    pub(super) fn bake(
        &self,
        mesh: &TriMesh,
        cards: Option<&Cards>,
        cancellation: &Cancellation,
    ) -> Vec<Option<SurfaceSample>> {
        let target = BakeTarget { mesh, atlas: self.atlas, texels: &self.texels, cards, keeps_area: true, parts: None };
        let mut samples = self.source.index.baker().bake(&target, cancellation);
        let is_opaque = || samples.iter().flatten().all(|sample| sample.color.w >= 0.5);
        if let Some(radius) = self.params.projection_radius.filter(|_| cards.is_none() && is_opaque()) {
            self.project(&target, radius, &mut samples, cancellation);
        }
        samples
    }

    /// Replaces the colours of the samples by those that the views at rest give. What no view reaches takes the colours
    /// around it.
    fn project(
        &self,
        target: &BakeTarget<'_>,
        radius: u32,
        samples: &mut [Option<SurfaceSample>],
        cancellation: &Cancellation,
    ) {
        let cameras: Vec<Camera> =
            self.views.iter().filter(|view| view.pose.is_none()).map(|view| view.camera).collect();
        let size = self.views.first().map_or(0, |view| view.image.size);
        let projection = Projection { cameras: &cameras, size, radius };
        let colors = self.source.index.baker().project(target, &projection, cancellation);
        let known: Vec<bool> = colors.iter().map(Option::is_some).collect();
        let mut texels: Vec<Vec4> = colors.into_iter().map(Option::unwrap_or_default).collect();
        fill_unknown(&mut texels, &known, self.texels.size);
        for (sample, color) in samples.iter_mut().zip(texels) {
            sample.iter_mut().for_each(|sample| sample.color = color.with_w(sample.color.w));
        }
    }

    /// Encoded colours with their gutters. With `alpha` the clear texels of a cut-out take the colour of their neighbours,
    /// which filtering mixes in.
    pub(super) fn initial(&self, samples: &[Option<SurfaceSample>], alpha: bool) -> TexelGrid {
        let size = self.texels.size;
        let covered: Vec<bool> = samples.iter().map(Option::is_some).collect();
        if self.params.initial == InitialTexture::Grey && !alpha {
            return TexelGrid { size, texels: vec![GREY; samples.len()], covered, opacity: Vec::new() };
        }
        let encoded = |s: &SurfaceSample| s.color.truncate().map(linear_to_srgb).extend(1.0);
        let mut texels: Vec<Vec4> =
            samples.par_iter().with_min_len(4096).map(|s| s.as_ref().map_or(Vec4::ZERO, encoded)).collect();
        let known = |s: &Option<SurfaceSample>| s.as_ref().is_some_and(|s| !alpha || s.color.w >= 0.5);
        let known: Vec<bool> = samples.iter().map(known).collect();
        fill_unknown(&mut texels, &known, size);
        let opacity = |s: &Option<SurfaceSample>| s.as_ref().map_or(0.0, |s| s.color.w);
        let opacity = if alpha { samples.iter().map(opacity).collect() } else { Vec::new() };
        let mut grid = TexelGrid { size, texels, covered, opacity };
        if alpha {
            grid.fill_opacity();
        }
        grid
    }

    /// How the texture is fitted. Not at all if the baked one has a single colour.
    pub(super) fn fit(&self, samples: &[Option<SurfaceSample>], trust: Option<f32>) -> Option<TextureFit> {
        let TextureParams { initial, smoothness, solver, .. } = self.params;
        let is_done = initial == InitialTexture::Baked && is_uniform(samples);
        (!is_done).then_some(TextureFit { smoothness, trust, solver })
    }
}

/// Every texel has the same base colour, to half a step of eight bits.
fn is_uniform(samples: &[Option<SurfaceSample>]) -> bool {
    let mut colors = samples.iter().flatten().map(|s| s.color);
    let first = colors.next().unwrap_or_default();
    colors.all(|c| (c - first).abs().max_element() < HALF_STEP)
}
