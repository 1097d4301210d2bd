//! A small scene that a device must draw as the CPU does, before it is trusted with levels.

use glam::{Mat4, Vec2, Vec3, Vec4};
use simpliguard::Cancellation;
use simpliguard::data::{Atlas, TriMesh};
use simpliguard::refine::{Backend, CoveredViews, Cpu, Device, Drawing, LowPoly, TexelGrid};
use simpliguard::render::{Camera, Image, View};

/// Sides of the image and of the texture.
const SIZE: usize = 64;
const TEXTURE: usize = 16;
/// Largest fraction of pixels that may show another triangle, as along edges.
const OTHER_TRIANGLE: f32 = 0.01;
/// Largest mean difference of the colours.
const DIFFERENCE: f32 = 1e-3;

/// An octahedron.
fn scene() -> LowPoly {
    let positions = vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let triangles = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let uv = |v: u32| positions[v as usize].truncate() * 0.4 + 0.5;
    let uvs: Vec<[Vec2; 3]> = triangles.iter().map(|t: &[u32; 3]| t.map(uv)).collect();
    let texel = |i: usize| Vec4::new((i % TEXTURE) as f32, (i / TEXTURE) as f32, 7.0, 16.0) / TEXTURE as f32;
    let texels: Vec<Vec4> = (0..TEXTURE * TEXTURE).map(texel).collect();
    let texture = TexelGrid { size: TEXTURE, covered: vec![true; texels.len()], texels, opacity: Vec::new() };
    LowPoly::new(&TriMesh { positions, triangles }, &Atlas { uvs, ..Atlas::default() }, false, texture)
}

/// A view from an odd angle.
fn view() -> View {
    let eye = Vec3::new(1.0, 1.7, 3.1);
    let depth = Mat4::from_cols(Vec4::X * 1.9, Vec4::Y * 1.9, Vec4::new(0.0, 0.0, -1.5, -1.0), Vec4::Z * -5.0);
    let camera = Camera { view_projection: depth * Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y), eye };
    View { camera, pose: None, image: Image { size: SIZE, pixels: vec![[0; 4]; SIZE * SIZE] } }
}

fn draw<E>(backend: &dyn Backend<Error = E>, low: &LowPoly, view: &View) -> Result<Drawing, E> {
    let cancellation = Cancellation::default();
    let mut renderer = backend.open(low, CoveredViews::new(vec![view]), &cancellation)?;
    renderer.draw(low, 0)
}

/// Draws the scene on both.
///
/// # Errors
/// What is wrong, in words.
pub(crate) fn run(gpu: &Device) -> Result<(), String> {
    let (low, view) = (scene(), view());
    let found = draw(gpu, &low, &view).map_err(|e| e.to_string())?;
    let Ok(expected) = draw(&Cpu, &low, &view);
    let pixels = (SIZE * SIZE) as f32;
    let other = expected.ids.iter().zip(&found.ids).filter(|(a, b)| a != b).count() as f32 / pixels;
    let apart = |(a, b): (&Vec4, &Vec4)| (*a - *b).abs().max_element();
    let difference = expected.colors.iter().zip(&found.colors).map(apart).sum::<f32>() / pixels;
    // Not a number is no small difference.
    if other <= OTHER_TRIANGLE && difference <= DIFFERENCE {
        return Ok(());
    }
    Err(format!(
        "it draws a test scene wrongly: {:.1} % of the pixels show another triangle, and colours differ by {difference:.4}",
        100.0 * other
    ))
}
