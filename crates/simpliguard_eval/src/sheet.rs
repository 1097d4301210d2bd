//! The contact sheet: source and levels side by side, from several sides, unlit and lit, with what differs.

use glam::Vec3;
use image::{DynamicImage, Rgb, RgbImage, imageops};
use rayon::prelude::*;
use simpliguard::data::{Level, Model};
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Image, Light, Renderer, SurfaceSampler};

/// Side of one picture in pixels.
const TILE: usize = 384;
/// Pixels between pictures.
const GAP: u32 = 4;
/// Encoded grey behind the pictures.
pub(crate) const BACKGROUND: f32 = 0.85;
/// Directions to look from: front right, front left from above, the back, from below.
pub(crate) const DIRECTIONS: [[f32; 3]; 4] = [[0.6, 0.35, 0.8], [-0.8, 0.6, 0.5], [-0.3, 0.25, -0.9], [0.5, -0.6, 0.6]];
/// How many times differences are enlarged.
const ENLARGED: i16 = 3;

/// Columns: the source, then the levels from the most faces to the fewest, each with its difference from the source
/// behind it (three times enlarged; white where there is none). Rows: four sides unlit, then the same lit.
pub fn contact_sheet(model: &Model, levels: &[Level]) -> RgbImage {
    let models: Vec<Model> = levels.iter().rev().map(|level| level.to_model(model)).collect();
    let frame = BoundingSphere::around(&model.surface.positions);
    let drawn: Vec<Vec<RgbImage>> =
        std::iter::once(model).chain(&models).collect::<Vec<_>>().par_iter().map(|model| draw(model, &frame)).collect();
    let mut columns = Vec::new();
    for (i, column) in drawn.iter().enumerate() {
        columns.push(column.clone());
        if i > 0 {
            columns.push(drawn[0].iter().zip(column).map(|(source, level)| difference(source, level)).collect());
        }
    }
    lay_out(&columns)
}

/// A column for each model, with the rows of [`contact_sheet`], all framed as the first.
pub fn side_by_side(models: &[&Model]) -> RgbImage {
    let Some(first) = models.first() else { return RgbImage::new(0, 0) };
    let frame = BoundingSphere::around(&first.surface.positions);
    lay_out(&models.par_iter().map(|model| draw(model, &frame)).collect::<Vec<_>>())
}

/// Pictures of one size in columns from the left, gaps between them.
pub(crate) fn lay_out(columns: &[Vec<RgbImage>]) -> RgbImage {
    let (tile_width, tile_height) = columns.first().and_then(|c| c.first()).map_or((0, 0), RgbImage::dimensions);
    let rows = columns.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let along = |i: u32, tile: u32| GAP + i * (tile + GAP);
    let mut sheet =
        RgbImage::from_pixel(along(columns.len() as u32, tile_width), along(rows, tile_height), Rgb([255; 3]));
    for (x, column) in (0..).zip(columns) {
        for (y, tile) in (0..).zip(column) {
            imageops::replace(&mut sheet, tile, along(x, tile_width).into(), along(y, tile_height).into());
        }
    }
    sheet
}

/// White where two pictures are alike.
fn difference(a: &RgbImage, b: &RgbImage) -> RgbImage {
    RgbImage::from_fn(a.width(), a.height(), |x, y| {
        let (a, b) = (a.get_pixel(x, y), b.get_pixel(x, y));
        let channel = |k: usize| (255 - ENLARGED * (i16::from(a[k]) - i16::from(b[k])).abs()).max(0) as u8;
        Rgb([channel(0), channel(1), channel(2)])
    })
}

fn draw(model: &Model, frame: &BoundingSphere) -> Vec<RgbImage> {
    let sampler = SurfaceSampler::new(model);
    let mut renderer = Renderer::new(&sampler, TILE, 2);
    let drawn = DIRECTIONS.map(|direction| {
        let camera = Camera::orbit(frame, Vec3::from(direction).normalize(), 0.6, 0.98);
        renderer.draw(&camera, [Light::None, Light::Head])
    });
    [0, 1].iter().flat_map(|light| drawn.iter().map(|images| shown(&images[*light]))).collect()
}

/// Over the background.
pub(crate) fn shown(image: &Image) -> RgbImage {
    DynamicImage::ImageRgba8(image.over(BACKGROUND)).to_rgb8()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sheet_has_a_column_for_the_source_and_two_per_level() {
        let sheet = contact_sheet(&Model::empty("nothing"), &[]);
        assert_eq!(sheet.width(), TILE as u32 + 2 * GAP);
        assert_eq!(sheet.height(), 8 * (TILE as u32 + GAP) + GAP);
        assert_eq!(sheet.get_pixel(TILE as u32 / 2, TILE as u32 / 2).0, [217; 3]);
    }

    #[test]
    fn tiles_stand_in_columns_with_gaps_between() {
        let tile = |value: u8| RgbImage::from_pixel(2, 2, Rgb([value; 3]));
        let sheet = lay_out(&[vec![tile(1), tile(2)], vec![tile(3)]]);
        assert_eq!(sheet.dimensions(), (3 * GAP + 4, 3 * GAP + 4));
        let at = |x: u32, y: u32| sheet.get_pixel(x, y).0[0];
        let second = 2 * GAP + 2;
        assert_eq!([at(GAP, GAP), at(GAP, second), at(second, GAP), at(second, second)], [1, 2, 3, 255]);
    }

    #[test]
    fn differences_are_enlarged_below_white() {
        let pixel = |rgb: [u8; 3]| RgbImage::from_pixel(1, 1, Rgb(rgb));
        assert_eq!(difference(&pixel([10, 100, 0]), &pixel([10, 110, 255])).get_pixel(0, 0).0, [255, 225, 0]);
    }
}
