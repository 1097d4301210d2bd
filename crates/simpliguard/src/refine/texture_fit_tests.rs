//! The texture and the outline that are fitted to views of a card are the card's own.

use std::convert::Infallible;

use glam::{Vec2, Vec3, Vec4};
use image::{Rgba, RgbaImage};

use super::cpu::Cpu;
use super::fit_opacity;
use super::low_poly::{LowPoly, TexelGrid};
use super::params::{Solver, TextureFit};
use super::train_validation::TrainValidationSplit;
use crate::Cancellation;
use crate::data::{AlphaMode, Atlas, Material, Model, Surface, Texture, TextureRef, TriMesh, Wrap};
use crate::geometry::{BoundingSphere, Random};
use crate::render::{Camera, Sampling, SurfaceSampler, View, take_views};

/// Side of the texture, and of the images: a texel is about as large as a pixel.
const TEXTURE: u32 = 64;
const SIZE: usize = 80;
/// Texels at the rim, whose neighbours are seen by no view.
const RIM: u32 = 4;

/// Noise, sRGB encoded.
fn noise() -> RgbaImage {
    let mut random = Random::new(5);
    RgbaImage::from_fn(TEXTURE, TEXTURE, |_, _| {
        let [r, g, b] = [0; 3].map(|_| 90 + (80.0 * random.unit()) as u8);
        Rgba([r, g, b, 255])
    })
}

fn mesh() -> TriMesh {
    let positions = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
    TriMesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] }
}

fn uv(position: Vec3) -> Vec2 {
    Vec2::new(0.5 + 0.5 * position.x, 0.5 - 0.5 * position.y)
}

/// Alpha of a disc, 0.6 of the side wide.
fn disc() -> RgbaImage {
    RgbaImage::from_fn(TEXTURE, TEXTURE, |x, y| Rgba([90, 120, 60, if distance(x, y) < RADIUS { 255 } else { 0 }]))
}

/// Radius of the disc in texels.
const RADIUS: f32 = 0.3 * TEXTURE as f32;

/// Distance of a texel from the middle, in texels.
fn distance(x: u32, y: u32) -> f32 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5).distance(Vec2::splat(0.5 * TEXTURE as f32))
}

fn card(picture: &RgbaImage, alpha_mode: AlphaMode) -> Model {
    let TriMesh { positions, triangles } = mesh();
    let surface = Surface {
        uvs: [positions.iter().map(|p| uv(*p)).collect(), Vec::new()],
        normals: vec![Vec3::Z; positions.len()],
        material: vec![0; triangles.len()],
        positions,
        triangles,
        ..Surface::default()
    };
    let texture = TextureRef { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY };
    let material = Material { base_color_texture: Some(texture), alpha_mode, ..Material::default() };
    let textures = vec![Texture::new(picture, [Wrap::Clamp; 2], true)];
    Model { surface, materials: vec![material], textures, ..Model::empty("card") }
}

fn views(card: &Model, sampling: Sampling) -> Vec<View> {
    let sphere = BoundingSphere { centre: Vec3::ZERO, radius: 1.5 };
    let mut random = Random::new(9);
    let cameras: Vec<Camera> = (0..24)
        .map(|_| {
            let direction = Vec3::new(random.unit() - 0.5, random.unit() - 0.5, 1.0).normalize();
            Camera::orbit(&sphere, direction, 0.7, 1.0 + 0.1 * random.unit())
        })
        .collect();
    take_views(&SurfaceSampler::new(card), &cameras, sampling)
}

/// The level of a card: the same quad, grey, with the alpha given.
fn level(opacity: Vec<f32>) -> LowPoly {
    let mesh = mesh();
    let atlas = Atlas {
        uvs: mesh.triangles.iter().map(|t| t.map(|v| uv(mesh.positions[v as usize]))).collect(),
        ..Atlas::default()
    };
    let texels = (TEXTURE * TEXTURE) as usize;
    let grey = vec![Vec4::new(0.5, 0.5, 0.5, 1.0); texels];
    let texture = TexelGrid { size: TEXTURE as usize, texels: grey, covered: vec![true; texels], opacity };
    LowPoly::new(&mesh, &atlas, false, texture)
}

/// Root of the mean squared error of a texture that begins grey and is fitted to the split's views.
fn error(mut split: TrainValidationSplit<'_, Infallible>) -> f32 {
    let mut low = level(Vec::new());
    let Ok(()) =
        split.fit_texture(&mut low, Some(&TextureFit { smoothness: 0.01, trust: None, solver: Solver::LeastSquares }));
    let (mut sum, mut count) = (0.0, 0);
    for (x, y, truth) in noise().enumerate_pixels() {
        if [x, y].iter().all(|k| (RIM..TEXTURE - RIM).contains(k)) {
            let truth = truth.0.map(|c| f32::from(c) / 255.0);
            let fitted = low.texture.texels[(y * TEXTURE + x) as usize];
            sum += (Vec4::from(truth) - fitted).truncate().length_squared();
            count += 3;
        }
    }
    (sum / count as f32).sqrt()
}

#[test]
fn a_texture_is_found_in_views_without_antialiasing() {
    let cancellation = Cancellation::default();
    let card = card(&noise(), AlphaMode::Opaque);
    let views = |samples| views(&card, Sampling { size: 2 * SIZE / samples, samples });
    let (points, means) = (views(1), views(2));
    let level = level(Vec::new());
    let Ok(of_points) = TrainValidationSplit::aliased(&points, &level, &Cpu, &cancellation);
    let Ok(of_means) = TrainValidationSplit::new(&means, &level, &Cpu, &cancellation);
    let (found, compensated) = (error(of_points), error(of_means));
    // Noise of 80 steps has a deviation of 23; rounding alone leaves 0.3.
    assert!(found < 0.02, "{found}");
    assert!(found < 0.5 * compensated, "{found} without antialiasing, {compensated} with it");
}

#[test]
fn an_outline_is_found_from_any_other() {
    let card = card(&disc(), AlphaMode::Mask { cutoff: 0.5 });
    let views = views(&card, Sampling { size: 2 * SIZE, samples: 1 });
    for opacity in [0.0, 1.0] {
        let mut low = level(vec![opacity; (TEXTURE * TEXTURE) as usize]);
        fit_opacity(&mut low, &views, &Cancellation::default());
        for (x, y, _) in disc().enumerate_pixels() {
            let (found, distance) = (low.texture.opacity[(y * TEXTURE + x) as usize], distance(x, y));
            if (distance - RADIUS).abs() > 1.5 && [x, y].iter().all(|k| (RIM..TEXTURE - RIM).contains(k)) {
                assert_eq!(found, if distance < RADIUS { 1.0 } else { 0.0 }, "texel {x}, {y} from {opacity}");
            }
        }
    }
}
