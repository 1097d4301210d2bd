//! Pictures of a source and its levels for a page: without light, with light, and what differs as a heat map.

use glam::Vec3;
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use simpliguard::data::Model;
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Light, Renderer, SurfaceSampler};

use crate::compare::flip::FlipImage;
use crate::compare::plane::Plane;
use crate::sheet::{DIRECTIONS, lay_out, shown};

/// Side of one picture in pixels.
const TILE: usize = 288;
/// Points along each side of a pixel.
const SAMPLES: usize = 3;
/// Vertical field of view in radians, and the part of a picture that the bounding sphere may exceed.
const FRAMING: (f32, f32) = (0.6, 0.98);
/// The colour map `magma` of Matplotlib (CC0) at nine even steps from 0 to 1.
const HEAT: [[u8; 3]; 9] = [
    [0, 0, 4],
    [27, 16, 68],
    [79, 18, 123],
    [129, 37, 129],
    [181, 54, 122],
    [229, 80, 100],
    [251, 135, 97],
    [254, 194, 135],
    [252, 253, 191],
];

/// Sheets of one layout. Columns: the source, then the levels in their order. Rows: the four sides of the contact sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Base colour alone.
    pub unlit: RgbImage,
    /// Under a lamp at the camera.
    pub lit: RgbImage,
    /// The FLIP error of each pixel without light, from black (none) to yellow (1). The source stands as in `unlit`.
    pub heat: RgbImage,
}

/// Draws a source and its levels, all framed as the source.
pub fn pictures(source: &Model, levels: &[&Model]) -> Pictures {
    let frame = BoundingSphere::around(&source.surface.positions);
    let all: Vec<&Model> = std::iter::once(source).chain(levels.iter().copied()).collect();
    let drawn: Vec<[Vec<RgbImage>; 2]> = all.par_iter().map(|model| draw(model, &frame)).collect();
    let columns = |light: usize| drawn.iter().map(|model| model[light].clone()).collect::<Vec<_>>();
    let unlit = columns(0);
    let heat = unlit.par_iter().enumerate().map(|(i, column)| {
        let against = |(a, b): (&RgbImage, &RgbImage)| if i == 0 { a.clone() } else { heat_map(a, b) };
        unlit[0].iter().zip(column).map(against).collect()
    });
    let heat: Vec<Vec<RgbImage>> = heat.collect();
    Pictures { unlit: lay_out(&unlit), lit: lay_out(&columns(1)), heat: lay_out(&heat) }
}

/// The four sides, without and with light.
fn draw(model: &Model, frame: &BoundingSphere) -> [Vec<RgbImage>; 2] {
    let sampler = SurfaceSampler::new(model);
    let mut renderer = Renderer::new(&sampler, TILE, SAMPLES);
    let drawn = DIRECTIONS.map(|direction| {
        let camera = Camera::orbit(frame, Vec3::from(direction).normalize(), FRAMING.0, FRAMING.1);
        renderer.draw(&camera, [Light::None, Light::Head])
    });
    [0, 1].map(|light| drawn.iter().map(|images| shown(&images[light])).collect())
}

/// The FLIP error of each pixel as a colour. Both images have one size.
fn heat_map(a: &RgbImage, b: &RgbImage) -> RgbImage {
    let [a_seen, b_seen] = [a, b].map(|image| FlipImage::new(&[0, 1, 2].map(|channel| plane(image, channel))));
    let mut map = RgbImage::new(a.width(), a.height());
    for (pixel, error) in map.pixels_mut().zip(a_seen.difference(&b_seen)) {
        *pixel = heat(error);
    }
    map
}

fn plane(image: &RgbImage, channel: usize) -> Plane {
    let values: Vec<f32> = image.pixels().map(|pixel| f32::from(pixel[channel]) / 255.0).collect();
    Plane { width: image.width() as usize, height: image.height() as usize, values }
}

/// The colour of an error from 0 to 1.
fn heat(error: f32) -> Rgb<u8> {
    let at = error.clamp(0.0, 1.0) * (HEAT.len() - 1) as f32;
    let step = (at as usize).min(HEAT.len() - 2);
    let fraction = at - step as f32;
    let mix = |k: usize| f32::from(HEAT[step][k]) * (1.0 - fraction) + f32::from(HEAT[step + 1][k]) * fraction;
    Rgb([0, 1, 2].map(|k| mix(k).round() as u8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sheet_has_a_column_for_each_model() {
        let [source, level] = ["source", "level"].map(Model::empty);
        let pictures = pictures(&source, &[&level, &level]);
        for sheet in [&pictures.unlit, &pictures.lit, &pictures.heat] {
            assert!(sheet.width() > 3 * TILE as u32 && sheet.height() > 4 * TILE as u32);
            assert_eq!(sheet.dimensions(), pictures.unlit.dimensions());
        }
    }

    #[test]
    fn heat_is_black_where_nothing_differs_and_brighter_where_more_does() {
        let grey = |value: u8| RgbImage::from_pixel(16, 16, Rgb([value; 3]));
        let centre = |a: u8, b: u8| *heat_map(&grey(a), &grey(b)).get_pixel(8, 8);
        assert_eq!(centre(90, 90), Rgb(HEAT[0]));
        let brightness = |pixel: Rgb<u8>| pixel.0.iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(brightness(centre(90, 110)) < brightness(centre(90, 250)));
        assert_eq!((heat(0.0), heat(1.0), heat(2.0)), (Rgb(HEAT[0]), Rgb(HEAT[8]), Rgb(HEAT[8])));
    }
}
