//! The skin: sandy with brown clouds and blue rings, pale suckers below the arms, golden eyes with a slit pupil.
//!
//! Every texel is looked up in the chart it lies in, so colours are evaluated on the surface itself and charts need no
//! gutter of their own: a chart's cell is painted to its edge.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use image::{ExtendedColorType, codecs::jpeg::JpegEncoder};
use libm::{cos, sin, sqrt};

use crate::shape::{ARM_ROOT, ARMS, EYE_RADIUS, Octopus, Part, bump, hash, noise, smoothstep};

const SIZE: u32 = 1024;
const JPEG_QUALITY: u8 = 88;
/// Texels between a chart and the edge of its cell.
const GUTTER: f64 = 4.0;

const SAND: DVec3 = DVec3::new(0.85, 0.66, 0.40);
const BROWN: DVec3 = DVec3::new(0.50, 0.27, 0.13);
const CREAM: DVec3 = DVec3::new(0.95, 0.86, 0.72);
const UMBER: DVec3 = DVec3::new(0.20, 0.11, 0.07);
const BLUE: DVec3 = DVec3::new(0.10, 0.46, 0.95);
const GOLD: DVec3 = DVec3::new(0.93, 0.70, 0.20);
const ROSE: DVec3 = DVec3::new(0.72, 0.44, 0.37);

/// The cell of the atlas a part is painted in, texels.
pub(crate) struct Chart {
    origin: DVec2,
    size: DVec2,
}

pub(crate) fn chart(part: Part) -> Chart {
    let cell = |x: usize, y: usize, w: usize, h: usize| Chart {
        origin: DVec2::new(x as f64, y as f64),
        size: DVec2::new(w as f64, h as f64),
    };
    match part {
        Part::Body => cell(0, 0, 1024, 456),
        Part::Arm(arm) => cell(arm * 128, 456, 128, 448),
        Part::Eye(side) => cell(side * 512, 904, 512, 120),
    }
}

impl Chart {
    /// Texture coordinates of a point of the part.
    pub(crate) fn uv(&self, along: f64, around: f64) -> DVec2 {
        let inner = self.size - DVec2::splat(2.0 * GUTTER);
        (self.origin + DVec2::splat(GUTTER) + inner * DVec2::new(around, along)) / f64::from(SIZE)
    }

    /// `(along, around)` of a texel's centre; outside `[0, 1]` in the gutter.
    fn parameters(&self, x: u32, y: u32) -> (f64, f64) {
        let inner = self.size - DVec2::splat(2.0 * GUTTER);
        let p = (DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - self.origin - DVec2::splat(GUTTER)) / inner;
        (p.y, p.x)
    }
}

/// The texture as a JPEG file.
pub(crate) fn paint(octopus: &Octopus) -> image::ImageResult<Vec<u8>> {
    let mut pixels = vec![0; 3 * (SIZE * SIZE) as usize];
    for part in Part::all() {
        let chart = chart(part);
        let rings = rings(octopus, part);
        for y in chart.origin.y as u32..(chart.origin.y + chart.size.y) as u32 {
            for x in chart.origin.x as u32..(chart.origin.x + chart.size.x) as u32 {
                let (along, around) = chart.parameters(x, y);
                let colour = match part {
                    Part::Eye(_) => eye(along.clamp(0.0, 1.0), around),
                    _ => skin(octopus, part, &rings, along.clamp(0.0, 1.0), around),
                };
                let texel = colour.clamp(DVec3::ZERO, DVec3::ONE) * 255.0 + DVec3::splat(0.5);
                let at = 3 * (y * SIZE + x) as usize;
                pixels[at..at + 3].copy_from_slice(&texel.to_array().map(|c| c as u8));
            }
        }
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode(&pixels, SIZE, SIZE, ExtendedColorType::Rgb8)?;
    Ok(jpeg)
}

struct Ring {
    centre: DVec3,
    radius: f64,
}

/// Ring marks by dart throwing: candidates in a fixed order, kept where they keep their distance.
fn rings(octopus: &Octopus, part: Part) -> Vec<Ring> {
    let (candidates, salt) = match part {
        Part::Body => (600, 100),
        Part::Arm(arm) => (90, arm as i64),
        Part::Eye(_) => (0, 0),
    };
    let mut rings: Vec<Ring> = Vec::new();
    for i in 0..candidates {
        let [s, a, size] = [0, 1, 2].map(|k| hash([salt, i, k]));
        let (along, around, radius) = match part {
            Part::Body => (0.34 + 0.64 * s, a, 0.013 + 0.009 * size),
            // The upper side only.
            _ => (ARM_ROOT + 0.6 * s, 0.14 + 0.22 * a, (0.011 + 0.003 * size) * (1.0 - 0.55 * s)),
        };
        let centre = octopus.point(part, along, around);
        let clear = |r: &Ring| r.centre.distance(centre) > 1.35 * (r.radius + radius);
        let beside_eyes = (0..2).all(|side| octopus.eye(side).0.distance(centre) > EYE_RADIUS + 0.012 + radius);
        if rings.iter().all(clear) && beside_eyes {
            rings.push(Ring { centre, radius });
        }
    }
    rings
}

fn skin(octopus: &Octopus, part: Part, rings: &[Ring], along: f64, around: f64) -> DVec3 {
    let p = octopus.point(part, along, around);
    let clouds = 0.6 * noise(p * 24.0) + 0.3 * noise(p * 55.0) + 0.1 * noise(p * 120.0);
    let grain = noise(p * 420.0) - 0.5;
    let mut colour = SAND.lerp(BROWN, smoothstep(0.44, 0.66, clouds)) * (1.0 + 0.16 * grain);

    let below = match part {
        Part::Body => smoothstep(0.17, 0.09, along),
        _ => smoothstep(0.02, -0.35, sin(around * TAU)),
    };
    colour = colour.lerp(CREAM * (0.97 + 0.1 * grain), below);
    if let Part::Arm(_) = part {
        colour = suckers(colour, along, around);
    }

    let mark = rings.iter().map(|r| p.distance(r.centre) / r.radius).fold(f64::INFINITY, f64::min);
    let wobble = mark + 0.14 * (noise(p * 160.0) - 0.5);
    colour = colour.lerp(UMBER, smoothstep(1.18, 1.02, wobble));
    colour = colour.lerp(BLUE * (0.9 + 0.5 * (clouds - 0.5)), smoothstep(0.98, 0.9, wobble));
    colour = colour.lerp(UMBER, smoothstep(0.6, 0.5, wobble));
    colour = colour.lerp(BROWN.lerp(SAND, 0.35), smoothstep(0.44, 0.3, wobble));

    // Skin darkens in the folds round the eyes.
    let fold: f64 = (0..2).map(|side| bump((octopus.eye(side).0.distance(p) - EYE_RADIUS) / 0.012)).sum();
    colour * (1.0 - 0.45 * fold.min(1.0))
}

/// Two rows of suckers that shrink towards the tip: each step along the arm is shorter than the one before.
fn suckers(colour: DVec3, along: f64, around: f64) -> DVec3 {
    const ROWS: f64 = 26.0;
    let progress = ROWS * along * (1.45 - 0.45 * along);
    let slope = ROWS * (1.45 - 0.9 * along);
    let row_offset = |centre: f64| (around - centre) / 0.052;
    let nearest = |shift: f64| {
        let x = progress + shift;
        (x - (x + 0.5).floor()) / slope / (0.36 / slope)
    };
    let distance = [(0.685, 0.0), (0.815, 0.5)]
        .map(|(centre, shift)| sqrt(row_offset(centre) * row_offset(centre) + nearest(shift) * nearest(shift)))
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    let rim = colour.lerp(ROSE, smoothstep(1.08, 0.92, distance));
    let disc = rim.lerp(CREAM * 1.05, smoothstep(0.84, 0.74, distance));
    disc.lerp(ROSE * 0.8, smoothstep(0.36, 0.24, distance))
}

fn eye(along: f64, around: f64) -> DVec3 {
    let polar = along * std::f64::consts::PI;
    let (x, y) = (polar * cos(around * TAU), polar * sin(around * TAU));
    let streaks = noise(DVec3::new(cos(around * TAU) * 9.0, sin(around * TAU) * 9.0, polar * 2.0));
    let iris = GOLD.lerp(BROWN, 0.75 * smoothstep(0.35, 0.75, streaks)).lerp(UMBER, smoothstep(0.82, 0.98, polar));
    let lid = BROWN.lerp(SAND, 0.25);
    let colour = iris.lerp(lid, smoothstep(1.0, 1.12, polar));
    // A rounded bar across the eye.
    let bar = DVec2::new((x.abs() - 0.36).max(0.0), y).length();
    let pupil = colour.lerp(DVec3::splat(0.03), smoothstep(0.2, 0.15, bar));
    let glint = DVec2::new(x - 0.28, y - 0.36).length();
    pupil.lerp(DVec3::ONE, smoothstep(0.15, 0.1, glint))
}

const _: () = assert!(ARMS * 128 == SIZE as usize, "the arms' charts fill the atlas' width");
