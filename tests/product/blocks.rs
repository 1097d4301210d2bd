//! Textures in blocks on a GPU.

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
fn psnr(a: &[u8], b: &[u8]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * a.len() as f64 / squares.max(1.0)).log10()
}
