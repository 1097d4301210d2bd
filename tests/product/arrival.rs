//! Pictures of a source that is loaded on demand: of its arrival, and once it is there.

use std::path::Path;

use bevy::prelude::*;
use bevy_simpliguard::lod::{LodSettings, SourceSettings, SourceStats};
use simpliguard::Cancellation;
use simpliguard::gltf::{compress_textures, divide};

use crate::blocks::psnr;
use crate::scene::{Scene, octopus};

/// Side of the pictures in pixels.
const SIDE: u32 = 240;
/// A place from which the source is seen, and one from which no camera wants it.
const NEAR: Vec3 = Vec3::new(0.3, 0.35, 0.89);
const FAR: f32 = 100.0;
/// Frames in which a source has come, or never will.
const PATIENCE: usize = 100;
/// A picture of the arrival is at most this much farther from the source's than that of the smallest level, in dB: both are
/// drawn at the same places.
const SLACK: f64 = 1.0;

fn look(scene: &mut Scene, place: Vec3) {
    scene.look_from(Transform::from_translation(place).looking_at(Vec3::ZERO, Vec3::Y));
}

fn stats(scene: &Scene) -> SourceStats {
    *scene.app.world().resource()
}

/// Saves the pictures of a test beside each other.
fn save(name: &str, pictures: &[&[u8]]) {
    let mut sheet = image::RgbaImage::new(SIDE * pictures.len() as u32, SIDE);
    for (i, picture) in pictures.iter().enumerate() {
        let picture = image::RgbaImage::from_raw(SIDE, SIDE, picture.to_vec()).expect("four bytes a pixel");
        image::imageops::replace(&mut sheet, &picture, i64::from(SIDE) * i as i64, 0);
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    sheet.save(folder.join(name)).expect("saves");
}

#[test]
#[ignore = "needs a Vulkan driver"]
#[expect(clippy::print_stdout, reason = "the figures")]
fn a_source_on_demand_arrives_without_a_gap_and_is_the_source() {
    let glb = compress_textures("octopus.glb", &octopus().glb, &Cancellation::default()).expect("a baked file");
    let divided = divide("octopus.glb", &glb).expect("a baked file").expect("source and levels");
    let mut always = Scene::new(glb, default(), SIDE, true);
    look(&mut always, NEAR);
    let [source, level] = [0, 1].map(|level| {
        always.force(Some(level));
        (0..20).for_each(|_| always.app.update());
        always.picture()
    });
    drop(always);

    let mut scene = Scene::on_demand(divided, SIDE);
    scene.app.world_mut().resource_mut::<SourceSettings>().keep = 0.0;
    // Small pictures would be content with a level.
    scene.app.world_mut().resource_mut::<LodSettings>().pixel_error = 0.1;
    look(&mut scene, Vec3::Z * FAR);
    let mut frames = 0;
    while stats(&scene).bytes > 0 && frames < PATIENCE {
        scene.app.update();
        frames += 1;
    }
    assert_eq!(stats(&scene).bytes, 0);
    look(&mut scene, NEAR);
    let (mut pictures, mut after) = (Vec::new(), 0);
    while pictures.len() < PATIENCE && after < 20 {
        pictures.push(scene.picture());
        after += usize::from(scene.lods().is_some_and(|lods| lods.current == 0));
    }
    let of_level = psnr(&level, &source);
    let all: Vec<f64> = pictures.iter().map(|picture| psnr(picture, &source)).collect();
    let last = pictures.last().expect("a picture");
    save("arrival.png", &[&source, &level, &pictures[0], &pictures[pictures.len() - 20], last]);
    println!("level: {of_level:.1} dB; arrival: {all:.1?}");
    assert!(all.iter().all(|psnr| *psnr > of_level - SLACK), "a gap");
    assert!(all.last().is_some_and(|psnr| *psnr > 45.0), "another picture than that of the source");
}
