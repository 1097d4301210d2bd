//! The contact sheet: source and levels side by side, from several sides, unlit and lit.

use glam::Vec3;
use image::{Rgb, RgbImage, imageops};
use rayon::prelude::*;
use simpliguard::model::{Level, Model};
use simpliguard::render::{Camera, Frame, Light, Picture, Renderer, SurfaceSampler};

/// Side of one picture in pixels.
const TILE: usize = 384;
/// Pixels between pictures.
const GAP: u32 = 4;
/// Encoded grey behind the pictures, and between them.
const BACKGROUND: f32 = 0.85;
/// Directions to look from: front right, front left from above, the back, from below.
const DIRECTIONS: [[f32; 3]; 4] = [[0.6, 0.35, 0.8], [-0.8, 0.6, 0.5], [-0.3, 0.25, -0.9], [0.5, -0.6, 0.6]];

/// Columns: the source, then the levels from the most faces to the fewest. Rows: four sides unlit, then the same lit.
pub fn contact_sheet(model: &Model, levels: &[Level]) -> RgbImage {
    let models: Vec<Model> = levels.iter().rev().map(|level| level.to_model(&model.name)).collect();
    let frame = Frame::around(&model.surface.positions);
    let columns: Vec<Vec<Picture>> =
        std::iter::once(model).chain(&models).collect::<Vec<_>>().par_iter().map(|model| draw(model, &frame)).collect();
    let step = TILE as u32 + GAP;
    let (width, height) = (columns.len() as u32 * step + GAP, 2 * DIRECTIONS.len() as u32 * step + GAP);
    let mut sheet = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    for (x, column) in columns.iter().enumerate() {
        for (y, picture) in column.iter().enumerate() {
            let tile = image::DynamicImage::ImageRgba8(picture.over(BACKGROUND)).to_rgb8();
            let at = |i: usize| i64::from(GAP + i as u32 * step);
            imageops::replace(&mut sheet, &tile, at(x), at(y));
        }
    }
    sheet
}

fn draw(model: &Model, frame: &Frame) -> Vec<Picture> {
    let sampler = SurfaceSampler::new(model);
    let mut renderer = Renderer::new(&sampler, TILE, 2);
    let mut pictures = Vec::new();
    for light in [Light::None, Light::Head] {
        for direction in DIRECTIONS {
            let camera = Camera::orbit(frame, Vec3::from(direction).normalize(), 0.6, 0.98);
            pictures.push(renderer.draw(&camera, light));
        }
    }
    pictures
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sheet_has_a_column_for_the_source_and_one_per_level() {
        let sheet = contact_sheet(&Model::empty("nothing"), &[]);
        assert_eq!(sheet.width(), TILE as u32 + 2 * GAP);
        assert_eq!(sheet.height(), 8 * (TILE as u32 + GAP) + GAP);
        assert_eq!(sheet.get_pixel(TILE as u32 / 2, TILE as u32 / 2).0, [217; 3]);
    }
}
