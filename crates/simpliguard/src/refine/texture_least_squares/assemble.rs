//! Assembles the normal equations from the pixels of all views.

use glam::{Vec2, Vec4Swizzles};
use rayon::prelude::*;

use super::normal_equations::NormalEquations;
use super::terms::LeastSquares;
use crate::Cancellation;
use crate::refine::covered_views::CoveredViews;
use crate::refine::forward::FrameBuffers;
use crate::refine::lookup::Lookup;
use crate::refine::low_poly::LowPoly;
use crate::render::raster::pixel_to_ndc;
use crate::render::{EMPTY_PIXEL, Rect, View};

/// Partial sums over the views: fixed, so that the result does not depend on the threads.
const PARTS: usize = 4;

/// The normal equations of every pixel that lies wholly on the source and on the level, in the rows and columns that count.
pub(super) fn assemble(
    low: &LowPoly,
    views: &CoveredViews<'_>,
    terms: LeastSquares<'_>,
    cancellation: &Cancellation,
) -> NormalEquations {
    let chunk = views.len().div_ceil(PARTS).max(1);
    let parts: Vec<NormalEquations> = views
        .views
        .par_chunks(chunk)
        .zip(views.rects.par_chunks(chunk))
        .map(|(chunk, rects)| {
            let mut assembly = Assembly::new(low, terms, views);
            for (view, rect) in chunk.iter().zip(rects).take_while(|_| !cancellation.is_cancelled()) {
                assembly.add_view(view, *rect);
            }
            assembly.equations
        })
        .collect();
    let sum = parts.into_iter().reduce(|mut sum, part| {
        sum.add(part);
        sum
    });
    sum.unwrap_or_else(|| NormalEquations::new(low.texture.size))
}

/// The equations of some of the views, and the buffers they are made with.
struct Assembly<'a> {
    low: &'a LowPoly,
    terms: LeastSquares<'a>,
    equations: NormalEquations,
    /// The weight of a pixel, which stands for those that are passed over as well.
    pixel_weight: f32,
    frame: FrameBuffers,
    /// Pixels on either side of a silhouette, which hold background. All false between views.
    silhouette: Vec<bool>,
}

impl<'a> Assembly<'a> {
    fn new(low: &'a LowPoly, terms: LeastSquares<'a>, views: &CoveredViews<'_>) -> Self {
        let size = views.size();
        Self {
            low,
            terms,
            equations: NormalEquations::new(low.texture.size),
            pixel_weight: views.pixel_weight() * terms.pixel_stride.pow(2) as f32,
            frame: FrameBuffers::new(size),
            silhouette: vec![false; size * size],
        }
    }

    fn add_view(&mut self, view: &View, rect: Rect) {
        let Self { low, frame, .. } = self;
        frame.rasterise(low, &view.camera, view.pose, rect);
        frame.find_blends(low);
        self.mark_silhouette(true);
        let Self { low, terms, equations, pixel_weight, frame, silhouette } = self;
        for y in frame.rect.rows().step_by(terms.pixel_stride) {
            let ndc_y = pixel_to_ndc(y, frame.size);
            for x in frame.rect.columns().step_by(terms.pixel_stride) {
                let i = y * frame.size + x;
                let id = frame.raster.ids[i];
                if id == EMPTY_PIXEL || silhouette[i] || view.image.pixels[i][3] != 255 {
                    continue;
                }
                let uv = frame.uv_at(low, id as usize, Vec2::new(pixel_to_ndc(x, frame.size), ndc_y)).0;
                let color = view.image.at(i).xyz();
                let weight = *pixel_weight * terms.coarse.map_or(1.0, |coarse| coarse.trust(uv, color));
                equations.add_pixel(Lookup::new(uv, low.texture.size), color, weight);
            }
        }
        self.mark_silhouette(false);
    }

    fn mark_silhouette(&mut self, mark: bool) {
        for blend in &self.frame.silhouettes.blends {
            self.silhouette[blend.near as usize] = mark;
            self.silhouette[blend.far as usize] = mark;
        }
    }
}
