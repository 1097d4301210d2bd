//! The rasteriser: cameras, visibility, and shaded pictures of a [`crate::data::Model`].
//!
//! One CPU rasteriser serves every stage that looks at a mesh: visibility and candidates ([`crate::simplify`]), texture
//! baking ([`crate::texture`]), differentiable rendering ([`crate::refine`]) and pictures. Cameras stand outside the
//! bounding sphere, so nothing is clipped; a triangle with a corner behind the camera is not drawn.

mod camera;
mod dilate;
mod image;
pub(crate) mod raster;
mod shading;
mod two_by_two;
mod view;
mod view_renderer;

pub use camera::{Camera, viewpoints};
pub use dilate::{dilate, fill_unknown};
pub use image::{Image, Light, Renderer};
pub use raster::{EMPTY_PIXEL, Raster, Rect};
pub use shading::{Footprint, SurfaceSample, SurfaceSampler};
pub(crate) use two_by_two::two_by_two;
pub use view::{View, take_posed_views, take_views};
pub use view_renderer::ViewParams;
pub(crate) use view_renderer::ViewRenderer;
