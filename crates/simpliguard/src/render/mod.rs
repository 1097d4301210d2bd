//! The renderer: cameras, visibility, and shaded images of a [`crate::data::Model`].
//!
//! One CPU rasteriser serves every stage that needs an image of a mesh: visibility and candidates
//! ([`crate::simplify`]), texture baking ([`crate::texture`]), differentiable rendering ([`crate::refine`]) and
//! previews. Cameras stand outside the bounding sphere, so nothing is clipped. A triangle with a corner behind the
//! camera is not drawn.

mod camera;
mod dilate;
mod image;
mod opacity;
mod pool;
pub(crate) mod raster;
mod renderer;
mod shader;
mod surface_sampler;
mod view;
mod view_renderer;

pub use camera::{Camera, viewpoints};
pub use dilate::{dilate, fill_unknown};
pub(crate) use image::difference_over;
pub use image::{Image, decibels};
pub use opacity::{Opacity, alpha_range, shown_fraction};
pub(crate) use pool::Pool;
pub use raster::{EMPTY_PIXEL, Raster, Rect, to_pixels};
pub use renderer::Renderer;
pub use shader::Light;
pub use surface_sampler::{Footprint, SurfaceSample, SurfaceSampler};
pub use view::{Sampling, View, take_views};
pub use view_renderer::ViewParams;
pub(crate) use view_renderer::ViewRenderer;
