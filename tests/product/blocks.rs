//! Textures in blocks on a GPU.

use bevy::math::{DMat4, DVec4};
use bevy::prelude::*;
use bevy::render::settings::WgpuFeatures;
use simpliguard::Cancellation;
use simpliguard::gltf::compress_textures;

use crate::scene::{Scene, octopus};

/// Side of the picture in pixels.
const SIDE: u32 = 360;
/// Least PSNR of pictures with blocks against pictures without, in dB.
const LEAST_PSNR: f64 = 36.0;

#[test]
#[ignore = "needs a Vulkan driver"]
#[expect(clippy::print_stdout, reason = "the figures")]
fn blocks_look_as_images_do_with_and_without_their_feature() {
    let glb = octopus().glb;
    let blocks = compress_textures("octopus.glb", &glb, &Cancellation::default()).expect("a baked file");
    let pictures = |features, glb: &Vec<u8>| {
        let mut scene = Scene::without(features, glb.clone(), SIDE);
        scene.look_from(Transform::from_xyz(0.3, 0.35, 0.89).looking_at(Vec3::ZERO, Vec3::Y));
        [0, 1, 2, 3].map(|level| {
            scene.force(Some(level));
            (0..20).for_each(|_| scene.app.update());
            scene.picture()
        })
    };
    let images = pictures(WgpuFeatures::empty(), &glb);
    for masked in [WgpuFeatures::empty(), WgpuFeatures::TEXTURE_COMPRESSION_BC] {
        let psnr: Vec<f64> = pictures(masked, &blocks).iter().zip(&images).map(|(a, b)| psnr(a, b)).collect();
        println!("PSNR of source and levels without {masked:?}: {psnr:.1?}");
        assert!(psnr.iter().all(|psnr| *psnr > LEAST_PSNR), "{psnr:?} without {masked:?}");
    }
}

/// The pictures are full of the model where it is seen, so the background counts little.
pub(crate) fn psnr(a: &[u8], b: &[u8]) -> f64 {
    10.0 * (255.0 * 255.0 / mean_square(a, b).max(1e-3)).log10()
}

/// The mean squared difference of bytes.
pub(crate) fn mean_square(a: &[u8], b: &[u8]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum::<f64>() / a.len() as f64
}

/// The mean squared error of an image whose blocks of 4 x 4 texels lie on one straight line of colours each, the best one. BC7
/// can have up to three lines in a block, so it comes closer, but for rounding. What its texels are not, such as those of
/// another mipmap or another curve of colours, is far above.
pub(crate) fn line_error(texels: &[u8], size: UVec2) -> f64 {
    let texel = |x: u32, y: u32| {
        let at = 4 * (y * size.x + x) as usize;
        DVec4::from_array([0, 1, 2, 3].map(|channel| f64::from(texels[at + channel])))
    };
    let blocks = (0..size.y.div_ceil(4)).flat_map(|row| (0..size.x.div_ceil(4)).map(move |column| (column, row)));
    let squares = blocks.map(|(column, row)| {
        let rows = 4 * row..size.y.min(4 * row + 4);
        let all = rows.flat_map(|y| (4 * column..size.x.min(4 * column + 4)).map(move |x| (x, y)));
        let all: Vec<DVec4> = all.map(|(x, y)| texel(x, y)).collect();
        let mean = all.iter().sum::<DVec4>() / all.len() as f64;
        let spread = all.iter().map(|texel| outer(*texel - mean)).fold(DMat4::ZERO, |sum, one| sum + one);
        let trace: f64 = (0..4).map(|i| spread.col(i)[i]).sum();
        trace - largest_eigenvalue(spread)
    });
    squares.sum::<f64>() / texels.len() as f64
}

fn outer(a: DVec4) -> DMat4 {
    DMat4::from_cols(a * a.x, a * a.y, a * a.z, a * a.w)
}

/// The largest eigenvalue of a symmetric matrix without negative ones, by iteration from below.
fn largest_eigenvalue(matrix: DMat4) -> f64 {
    let mut axis = DVec4::new(1.0, 0.9, 0.8, 0.1);
    for _ in 0..100 {
        axis = (matrix * axis).normalize_or_zero();
    }
    axis.dot(matrix * axis)
}

#[test]
fn lines_through_blocks_leave_what_is_beside_them() {
    let of = |colours: [[u8; 4]; 4]| line_error(&[colours.as_flattened(); 4].concat(), UVec2::splat(4));
    let grey = [0, 40, 80, 240].map(|byte| [byte, byte, byte, 255]);
    assert!(of(grey) < 1e-6);
    // A cross: the line takes its longer arm, and 4 * 2 of 64 bytes are 10 beside it.
    let cross = [[120, 100, 0, 255], [80, 100, 0, 255], [100, 110, 0, 255], [100, 90, 0, 255]];
    assert!((of(cross) - 8.0 * 100.0 / 64.0).abs() < 1e-6);
}
