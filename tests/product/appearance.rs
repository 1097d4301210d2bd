//! A level looks in Bevy as it does in the bake's own pictures, and as its source does where the two switch: the filters of the
//! game's textures take nothing from it, and neither do blocks.

use std::f32::consts::FRAC_PI_4;

use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::prelude::*;
use bevy_simpliguard::lod::LodPlugin;
use simpliguard::Cancellation;
use simpliguard::data::Model;
use simpliguard::gltf::compress_textures;
use simpliguard::render::{Camera, Light, Renderer, SurfaceSampler};

use crate::scene::{PLACE, Scene, octopus};

/// Side of the pictures in pixels.
const SIDE: u32 = 1440;
/// Length of the octopus' diagonal in metres.
const DIAGONAL: f32 = 1.1;
/// Factor on the difference of a level from its source that blocks may cost.
const BLOCKS_COST: f64 = 1.05;
/// What a level may lose in the game, in dB.
const LOSS: f64 = 1.0;

#[test]
#[ignore = "needs a Vulkan driver"]
#[expect(clippy::print_stdout, reason = "the figures")]
fn levels_look_in_the_game_as_in_the_bake() {
    let baked = octopus();
    let source = baked.model.as_ref().expect("a model");
    let mut scene = Scene::new(baked.glb.clone(), anisotropic(), SIDE, true);
    show_colours_alone(&mut scene);
    for (level, number) in baked.levels.iter().zip(1..) {
        let model = level.to_model(source);
        for factor in [1.0, 0.5] {
            let eye = factor * switching_place(&scene, number);
            let game = psnr([0, number].map(|level| photograph(&mut scene, level, eye)));
            let bake = psnr([source, &model].map(|model| draw(model, eye)));
            println!("LOD{number} at {factor} of its distance: {game:.2} dB in the game, {bake:.2} dB in the bake");
            assert!(game > bake - LOSS, "LOD{number} loses {:.2} dB in the game", bake - game);
        }
    }
}

/// How source and level are filtered.
struct Filters {
    name: &'static str,
    source: LodPlugin,
    level: LodPlugin,
    blocks: bool,
}

/// Filters as on a graphics card, also where the renderer runs in software.
fn anisotropic() -> LodPlugin {
    LodPlugin { anisotropy: Some(8), ..default() }
}

fn filters() -> [Filters; 3] {
    let no_mipmaps = LodPlugin { mipmaps: false, ..default() };
    let isotropic = LodPlugin { anisotropy: Some(1), ..default() };
    [
        Filters { name: "mipmaps for levels alone", source: no_mipmaps, level: isotropic, blocks: false },
        Filters { name: "both alike", source: anisotropic(), level: anisotropic(), blocks: false },
        Filters { name: "both alike, in blocks", source: anisotropic(), level: anisotropic(), blocks: true },
    ]
}

/// The difference of each level from its source where they switch, with these filters: without light and with it, for each level.
fn differences(glb: &[u8], filters: &Filters) -> Vec<[f64; 2]> {
    let scene = |levels: &LodPlugin| Scene::new(glb.to_vec(), levels.clone(), SIDE, true);
    let mut scenes = [scene(&filters.source), scene(&filters.level)];
    scenes.iter_mut().for_each(show_on_white);
    let mut out = vec![[0.0; 2]; 3];
    for light in [1, 0] {
        if light == 0 {
            scenes.iter_mut().for_each(show_colours_alone);
        }
        for (number, difference) in (1..).zip(&mut out) {
            let eye = switching_place(&scenes[0], number);
            let [source, level] = &mut scenes;
            let pictures = [photograph(source, 0, eye), photograph(level, number, eye)];
            difference[light] = 255.0 * 10.0_f64.powf(-psnr(pictures) / 20.0);
        }
    }
    out
}

#[test]
#[ignore = "needs a Vulkan driver"]
#[expect(clippy::print_stdout, reason = "the figures")]
fn levels_look_like_their_source_where_they_switch() {
    let glb = octopus().glb;
    let blocks = compress_textures("octopus.glb", &glb, &Cancellation::default()).expect("a baked file");
    let found = filters().map(|filters| {
        let found = differences(if filters.blocks { &blocks } else { &glb }, &filters);
        println!("{}: {found:.2?}", filters.name);
        found
    });
    let [apart, alike, in_blocks] = found.map(|levels| levels.concat());
    let each = apart.iter().zip(&alike).zip(&in_blocks);
    for ((apart, alike), in_blocks) in each {
        assert!(alike < apart, "filters that differ come closer");
        assert!(*in_blocks < BLOCKS_COST * alike, "blocks change the look: {in_blocks:.2} for {alike:.2}");
    }
}

/// Where the level's error is one pixel.
fn switching_place(scene: &Scene, number: u32) -> Vec3 {
    let mut levels = scene.lods().expect("levels").levels.iter();
    let level = levels.find(|level| level.level == number).expect("a level");
    switching_distance(level.error) * Vec3::new(0.3, 0.35, 0.89).normalize()
}

/// The distance at which the level's error is one pixel.
fn switching_distance(error: f32) -> f32 {
    let pixels_at_one_metre = 0.5 * SIDE as f32 / (0.5 * FRAC_PI_4).tan();
    pixels_at_one_metre * DIAGONAL * error
}

/// Shows colours as they are, on white.
fn show_on_white(scene: &mut Scene) {
    let world = scene.app.world_mut();
    world.resource_mut::<ClearColor>().0 = Color::WHITE;
    world.entity_mut(scene.camera).insert(Tonemapping::None);
    scene.settle();
}

/// Shows colours as the textures have them, on white.
fn show_colours_alone(scene: &mut Scene) {
    for (_, material) in scene.app.world_mut().resource_mut::<Assets<StandardMaterial>>().iter_mut() {
        material.unlit = true;
    }
    show_on_white(scene);
}

fn photograph(scene: &mut Scene, level: u32, eye: Vec3) -> Vec<u8> {
    scene.force(Some(level));
    scene.look_from(Transform::from_translation(eye).looking_at(Vec3::ZERO, Vec3::Y));
    (0..4).for_each(|_| scene.app.update());
    scene.picture()
}

/// The same by the bake's renderer.
fn draw(model: &Model, eye: Vec3) -> Vec<u8> {
    let view = Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y) * Mat4::from_translation(PLACE);
    let projection = Mat4::perspective_rh_gl(FRAC_PI_4, 1.0, 0.1, 100.0);
    let camera = Camera { view_projection: projection * view, eye: eye - PLACE };
    let sampler = SurfaceSampler::new(model);
    let [image] = Renderer::new(&sampler, SIDE as usize, 2).draw(&camera, [Light::None]);
    image.over(1.0).pixels().flat_map(|p| p.0).collect()
}

/// Peak signal-to-noise ratio of two pictures, over the pixels that are not white in both.
fn psnr([a, b]: [Vec<u8>; 2]) -> f64 {
    let pixels = a.chunks_exact(4).zip(b.chunks_exact(4)).map(|(a, b)| (&a[..3], &b[..3]));
    let touched = pixels.filter(|(a, b)| a.iter().chain(*b).any(|x| *x < 255));
    let (count, sum) = touched.fold((0, 0.0), |(count, sum), (a, b)| {
        let squares = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
        (count + 3, sum + squares.sum::<f64>())
    });
    10.0 * (255.0 * 255.0 * f64::from(count) / sum).log10()
}
