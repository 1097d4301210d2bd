//! The views of a bake.

use rayon::prelude::*;

use super::params::Params;
use super::runner::Runner;
use super::source::SourceIndex;
use crate::render::{View, ViewRenderer};
use crate::{Error, StageId};

/// Standard deviation of the colours of a source that has one colour, in steps of eight bits.
const ONE_COLOR: f64 = 5.0;

/// Views of the source.
pub(crate) struct Views<'a> {
    renderer: ViewRenderer<'a>,
    /// At full resolution: vertices are fitted to them.
    pub(crate) full: Vec<View>,
    /// The same under light, if the source has one colour: without it, all that they show is an outline.
    lit: Option<Vec<View>>,
    /// The same at twice the size, without antialiasing: textures are fitted to them. Empty if none are.
    pub(crate) aliased: Vec<View>,
    /// At half resolution: vertices are moved by them first. `None` while no level is known to need them.
    pub(crate) half_resolution: Option<Vec<View>>,
}

impl<'a> Views<'a> {
    /// Renders the views of full resolution.
    pub(crate) fn render(index: &'a SourceIndex<'a>, params: &Params, run: &Runner<'a>) -> Result<Self, Error> {
        let renderer = index.view_renderer(params.views, run.cancellation());
        let (full, lit, aliased) = run.run(StageId::Views, || {
            let aliased = renderer.aliased_views();
            let full: Vec<View> = aliased.par_iter().filter_map(View::halved).collect();
            let lit = has_one_color(&full).then(|| renderer.lit_views(&full));
            (full, lit, if params.refine.enabled { aliased } else { Vec::new() })
        })?;
        Ok(Self { renderer, full, lit, aliased, half_resolution: None })
    }

    /// The views that candidates are scored by.
    pub(crate) fn scored(&self) -> &[View] {
        self.lit.as_deref().unwrap_or(&self.full)
    }

    /// Renders the views of half resolution.
    pub(crate) fn render_half_resolution(&self, params: &Params, run: &Runner<'_>) -> Vec<View> {
        let further = params.refine.half_resolution_views;
        run.time(StageId::Views, || self.renderer.half_resolution_views(&self.full, further))
    }

    /// Renders the views of half resolution if some level needs them and they are still missing.
    pub(crate) fn complete(&mut self, needs_half_resolution: bool, params: &Params, run: &Runner<'_>) {
        if self.half_resolution.is_none() && needs_half_resolution {
            self.half_resolution = Some(self.render_half_resolution(params, run));
        }
    }
}

/// Every covered pixel has nearly the same colour.
fn has_one_color(views: &[View]) -> bool {
    let covered = views.iter().flat_map(|view| &view.image.pixels).filter(|pixel| pixel[3] == u8::MAX);
    let (mut count, mut sums, mut squares) = (0_u64, [0_u64; 3], [0_u64; 3]);
    for pixel in covered {
        count += 1;
        for (channel, value) in pixel[..3].iter().map(|v| u64::from(*v)).enumerate() {
            sums[channel] += value;
            squares[channel] += value * value;
        }
    }
    let variance = |channel: usize| {
        let mean = sums[channel] as f64 / count as f64;
        squares[channel] as f64 / count as f64 - mean * mean
    };
    count > 0 && (0..3).all(|channel| variance(channel) < ONE_COLOR * ONE_COLOR)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::BoundingSphere;
    use crate::render::{Camera, Image};

    fn view(pixels: Vec<[u8; 4]>) -> View {
        let camera = Camera::orbit(&BoundingSphere { centre: Vec3::ZERO, radius: 1.0 }, Vec3::Z, 0.7, 1.0);
        View { camera, pose: None, image: Image { size: 2, pixels } }
    }

    #[test]
    fn one_colour_is_one_in_all_views_whatever_the_background() {
        let pale = || view(vec![[200, 190, 180, 255], [202, 190, 179, 255], [0, 0, 0, 0], [100, 95, 90, 128]]);
        let dark = view(vec![[90, 80, 70, 255]; 4]);
        assert!(has_one_color(&[pale(), pale()]));
        assert!(!has_one_color(&[pale(), dark]));
        assert!(!has_one_color(&[view(vec![[0; 4]; 4])]), "nothing has no colour");
    }
}
