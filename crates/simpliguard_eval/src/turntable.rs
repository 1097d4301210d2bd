//! The turntable: source and levels side by side, turning once, as an animated PNG.

use glam::Vec3;
use image::RgbImage;
use rayon::prelude::*;
use simpliguard::data::Model;
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Light, Renderer, SurfaceSampler};

use crate::sheet::{lay_out, shown};

/// Side of one picture in pixels.
const TILE: usize = 288;
/// Pictures of one turn.
const FRAMES: u32 = 36;
/// Pictures a second.
const RATE: u16 = 12;
/// Height of the camera above the horizon, as a part of its distance along it.
const RISE: f32 = 0.35;

/// The picture cannot be encoded.
#[derive(Debug, thiserror::Error)]
#[error("the turntable cannot be encoded: {0}")]
pub struct TurntableError(#[from] png::EncodingError);

/// An animated PNG of one endless turn. Columns: the source, then `levels` in their order. Rows: unlit, lit.
///
/// # Errors
/// If it is too large for a PNG.
pub fn turntable(source: &Model, levels: &[Model]) -> Result<Vec<u8>, TurntableError> {
    let frame = BoundingSphere::around(&source.surface.positions);
    let columns: Vec<Vec<[RgbImage; 2]>> =
        std::iter::once(source).chain(levels).map(|model| turn(model, &frame)).collect();
    let frames = (0..FRAMES as usize).map(|i| {
        let at_step: Vec<Vec<RgbImage>> = columns.iter().map(|column| column[i].to_vec()).collect();
        lay_out(&at_step)
    });
    Ok(animated(frames.collect())?)
}

/// Unlit and lit, from all sides.
fn turn(model: &Model, frame: &BoundingSphere) -> Vec<[RgbImage; 2]> {
    let sampler = SurfaceSampler::new(model);
    let draw = |renderer: &mut Renderer<'_>, i: u32| {
        let angle = i as f32 / FRAMES as f32 * std::f32::consts::TAU;
        let (sin, cos) = angle.sin_cos();
        let camera = Camera::orbit(frame, Vec3::new(sin, RISE, cos).normalize(), 0.6, 0.98);
        renderer.draw(&camera, [Light::None, Light::Head]).map(|image| shown(&image))
    };
    (0..FRAMES).into_par_iter().map_init(|| Renderer::new(&sampler, TILE, 2), draw).collect()
}

fn animated(frames: Vec<RgbImage>) -> Result<Vec<u8>, png::EncodingError> {
    let Some((width, height)) = frames.first().map(RgbImage::dimensions) else { return Ok(Vec::new()) };
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(frames.len() as u32, 0)?;
    encoder.set_frame_delay(1, RATE)?;
    let mut writer = encoder.write_header()?;
    for frame in &frames {
        writer.write_image_data(frame)?;
    }
    writer.finish()?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_turn_is_an_animation_of_all_frames() {
        let bytes = turntable(&Model::empty("nothing"), &[Model::empty("level")]).expect("encodes");
        let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG");
        let control = reader.info().animation_control().expect("animated");
        assert_eq!((control.num_frames, control.num_plays), (FRAMES, 0));
        assert!(reader.info().width > 2 * TILE as u32 && reader.info().height > 2 * TILE as u32);
    }
}
