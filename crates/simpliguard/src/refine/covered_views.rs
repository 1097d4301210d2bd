use rayon::prelude::*;

use crate::render::{Image, Rect, View};

/// Views with the pixels that the source covers in each.
#[derive(Clone)]
pub struct CoveredViews<'a> {
    /// The views, all of one size.
    pub views: Vec<&'a View>,
    /// Rectangle around the pixels that the source touches, one a view.
    pub rects: Vec<Rect>,
    /// The views are not antialiased: each pixel is one point, in the views as in the level's image, and they are scored by
    /// the means of four.
    pub aliased: bool,
}

/// Weight of a pixel of a view without antialiasing: four of them lie in one of an antialiased view.
const ALIASED_PIXEL_WEIGHT: f32 = 0.25;

impl<'a> CoveredViews<'a> {
    /// Antialiased views.
    pub fn new(views: Vec<&'a View>) -> Self {
        let rects = views.par_iter().map(|view| covered_rect(&view.image)).collect();
        Self { views, rects, aliased: false }
    }

    /// Views without antialiasing. Their sides are even.
    pub fn aliased(views: Vec<&'a View>) -> Self {
        Self { aliased: true, ..Self::new(views) }
    }

    /// One view in `stride`, from the first.
    pub(super) fn every(&self, stride: usize) -> Self {
        let views = self.views.iter().copied().step_by(stride).collect();
        Self { views, rects: self.rects.iter().copied().step_by(stride).collect(), ..*self }
    }

    /// Weight of a pixel when textures are fitted.
    pub fn pixel_weight(&self) -> f32 {
        if self.aliased { ALIASED_PIXEL_WEIGHT } else { 1.0 }
    }

    /// Number of views.
    pub(super) fn len(&self) -> usize {
        self.views.len()
    }

    /// Side of the views in pixels; zero without views.
    pub fn size(&self) -> usize {
        self.views.first().map_or(0, |view| view.image.size)
    }
}

/// The rectangle of pixels that the source touches.
fn covered_rect(image: &Image) -> Rect {
    let n = image.size;
    let mut rect = Rect { x0: n, y0: n, x1: 0, y1: 0 };
    for y in 0..n {
        let row = &image.pixels[y * n..(y + 1) * n];
        if let (Some(first), Some(last)) = (row.iter().position(|p| p[3] > 0), row.iter().rposition(|p| p[3] > 0)) {
            rect = Rect { x0: rect.x0.min(first), x1: rect.x1.max(last + 1), y0: rect.y0.min(y), y1: y + 1 };
        }
    }
    rect
}
