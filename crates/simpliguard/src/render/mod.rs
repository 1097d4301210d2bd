//! The rasteriser: cameras, visibility, and shaded pictures of a [`crate::model::Model`].
//!
//! One CPU rasteriser serves every stage that looks at a mesh: visibility and candidates ([`crate::shape`]), texture
//! baking ([`crate::texture`]), differentiable rendering ([`crate::refine`]) and pictures. Cameras stand outside the
//! bounding sphere, so nothing is clipped; a triangle with a corner behind the camera is not drawn.

mod camera;
mod picture;
pub(crate) mod raster;
mod shading;
mod view;

pub use camera::{Camera, Frame, Random, fibonacci_directions, viewpoints};
pub use picture::{Light, Picture, Renderer};
pub use raster::{NOTHING, Raster, Rect};
pub use shading::{Footprint, SurfaceSample, SurfaceSampler};
pub use view::{Motions, View, halve_views, take_posed_views, take_views};
