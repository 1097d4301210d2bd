use crate::render::{Image, Rect, View};

/// Views with the pixels that the source covers in each.
pub(super) struct CoveredViews<'a> {
    pub(super) views: Vec<&'a View>,
    /// Rectangle around the pixels that the source touches, one a view.
    pub(super) rects: Vec<Rect>,
    /// Weight of a pixel when textures are fitted.
    pub(super) pixel_weight: f32,
}

impl<'a> CoveredViews<'a> {
    pub(super) fn new(views: Vec<&'a View>) -> Self {
        let rects = views.iter().map(|view| covered_rect(&view.image)).collect();
        Self { views, rects, pixel_weight: 1.0 }
    }

    /// One view in `stride`, from the first.
    pub(super) fn every(&self, stride: usize) -> Self {
        let views = self.views.iter().copied().step_by(stride).collect();
        Self { views, rects: self.rects.iter().copied().step_by(stride).collect(), ..*self }
    }

    /// Number of views.
    pub(super) fn len(&self) -> usize {
        self.views.len()
    }

    /// Side of the views in pixels; zero without views.
    pub(super) fn size(&self) -> usize {
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
