//! Fits the outlines of a cut-out to the views, by votes of their pixels.
//!
//! A card shows a group of leaves along its own normal. From other directions it covers gaps between leaves, and its leaves
//! miss the outline. So each pixel of each view votes on the texels that the level shows there: one that shows a texel where
//! the source has nothing wants it clear, one that would show the background without it wants it opaque. A clear texel in
//! front of nothing gets votes alike. Where one texel covers another, the one behind it decides in the next round: space
//! carving (Kutulakos and Seitz 2000) on the texels of cards.

use glam::Vec2;
use rayon::prelude::*;

use super::covered_views::CoveredViews;
use super::forward::FrameBuffers;
use super::lookup::Lookup;
use super::low_poly::{CUTOFF, LowPoly, TexelGrid};
use crate::Cancellation;
use crate::render::raster::pixel_to_ndc;
use crate::render::{EMPTY_PIXEL, Rect, View};

/// Most rounds of votes.
const ROUNDS: usize = 4;
/// Least difference of votes that changes a texel.
const LEAST: f32 = 0.5;
/// Vote of a pixel of the source for the texel that it sees in front of another one.
const COVERED_TWICE: f32 = 0.1;
/// Number of partial sums, whatever the number of threads: the order of additions is always the same.
const PARTS: usize = 4;

/// Makes texels of a cut-out clear or opaque, as the pixels that show them want it. Ends early if cancelled.
pub(super) fn fit_opacity(low: &mut LowPoly, views: &CoveredViews<'_>, cancellation: &Cancellation) {
    for _ in 0..ROUNDS {
        let votes = votes(low, views, cancellation);
        if cancellation.is_cancelled() || !change(&mut low.texture, &votes) {
            return;
        }
    }
}

/// Changes the texels that enough votes want changed. False if there are none.
fn change(texture: &mut TexelGrid, votes: &[f32]) -> bool {
    let mut changed = false;
    for (i, vote) in votes.iter().enumerate().filter(|(i, vote)| texture.covered[*i] && vote.abs() >= LEAST) {
        let wanted = if *vote > 0.0 { 1.0 } else { 0.0 };
        if (texture.opacity[i] >= CUTOFF) != (wanted >= CUTOFF) {
            texture.opacity[i] = wanted;
            changed = true;
        }
    }
    if changed {
        texture.fill_opacity();
    }
    changed
}

/// Votes on each texel: positive if it should be opaque. Those of some views if cancelled.
fn votes(low: &LowPoly, views: &CoveredViews<'_>, cancellation: &Cancellation) -> Vec<f32> {
    let all: Vec<(&View, Rect)> = views.views.iter().copied().zip(views.rects.iter().copied()).collect();
    let part = all.len().div_ceil(PARTS).max(1);
    let parts: Vec<Vec<f32>> = all.par_chunks(part).map(|views| votes_of(low, views, cancellation)).collect();
    let mut votes = vec![0.0; low.texture.opacity.len()];
    parts.iter().for_each(|part| votes.iter_mut().zip(part).for_each(|(sum, n)| *sum += n));
    votes
}

fn votes_of(low: &LowPoly, views: &[(&View, Rect)], cancellation: &Cancellation) -> Vec<f32> {
    let mut votes = vec![0.0; low.texture.opacity.len()];
    let Some((first, _)) = views.first() else { return votes };
    let mut layers = Layers::new(first.image.size);
    for (view, rect) in views.iter().take_while(|_| !cancellation.is_cancelled()) {
        layers.rasterise(low, view, *rect);
        layers.vote(low, view, &mut votes);
    }
    votes
}

/// What a view shows of a cut-out.
struct Layers {
    /// The nearest texels that are opaque.
    front: FrameBuffers,
    /// The nearest opaque texels of other triangles than those in front.
    behind: FrameBuffers,
    /// The nearest texels, as if all were opaque.
    whole: FrameBuffers,
}

impl Layers {
    fn new(size: usize) -> Self {
        Self { front: FrameBuffers::new(size), behind: FrameBuffers::new(size), whole: FrameBuffers::new(size) }
    }

    fn rasterise(&mut self, low: &LowPoly, view: &View, rect: Rect) {
        self.front.rasterise(low, &view.camera, view.pose, rect);
        self.behind.rasterise_behind(low, &view.camera, view.pose, (rect, &self.front.raster.ids));
        self.whole.rasterise_whole(low, &view.camera, view.pose, rect);
    }

    fn vote(&self, low: &LowPoly, view: &View, votes: &mut [f32]) {
        let size = self.front.size;
        for y in self.front.rect.rows() {
            for x in self.front.rect.columns() {
                let i = y * size + x;
                let shown = self.front.raster.ids[i] != EMPTY_PIXEL;
                let frame = if shown { &self.front } else { &self.whole };
                let id = frame.raster.ids[i];
                if id == EMPTY_PIXEL {
                    continue;
                }
                let covers = if self.behind.raster.ids[i] == EMPTY_PIXEL { 1.0 } else { COVERED_TWICE };
                let vote = if view.image.pixels[i][3] < 128 { -1.0 } else { covers };
                let ndc = Vec2::new(pixel_to_ndc(x, size), pixel_to_ndc(y, size));
                let lookup = Lookup::new(frame.uv_at(low, id as usize, ndc).0, low.texture.size);
                for (texel, weight) in lookup.texels(low.texture.size).into_iter().zip(lookup.weights()) {
                    votes[texel] += weight * vote;
                }
            }
        }
    }
}
