//! What a change of level does to the picture: a camera comes closer to a model that shows all its levels in turn, and no
//! frame may differ from the one before by much more than its neighbours do.

use bevy::core_pipeline::core_3d::Opaque3d;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::render_phase::{BinnedRenderPhase, ViewBinnedRenderPhases};
use bevy_simpliguard::lod::{LodPlugin, LodSettings, LodStats};
use simpliguard::gltf::compress_textures;
use simpliguard::settings::{Layer, Origin, parse_meta, resolve};
use simpliguard::{Cancellation, Context, NoResources, Source, bake};

use crate::scene::{Scene, octopus};
use crate::village;

/// Side of the picture in pixels.
const SIDE: u32 = 360;
/// Frames of the camera's move.
const FRAMES: usize = 200;
/// Distances of the camera from the octopus at the first and last frame: its diagonal of 1.1 m is 130 and 1,200 pixels long.
const WAY: (f32, f32) = (4.0, 0.92);
/// The same where it is 40 pixels long, and hardly grows.
const AFAR: (f32, f32) = (13.0, 12.5);
/// A frame whose difference from the one before is more than this many times the median of its neighbours' is a pop.
const POP: f64 = 1.15;
/// Neighbours on each side of a frame.
const NEIGHBOURS: usize = 5;

#[test]
#[ignore = "draws 600 pictures: needs a Vulkan driver, and minutes where that is software"]
fn levels_do_not_pop() {
    approach(octopus().glb);
}

#[test]
#[ignore = "draws 600 pictures: needs a Vulkan driver, and minutes where that is software"]
fn levels_in_blocks_do_not_pop() {
    let blocks = compress_textures("octopus.glb", &octopus().glb, &Cancellation::default());
    approach(blocks.expect("a baked file"));
}

#[expect(clippy::print_stdout, reason = "the figures")]
fn approach(glb: Vec<u8>) {
    let mut scene = Scene::new(glb, LodPlugin::default(), SIDE, true);
    let (with, levels) = scene.approach(WAY, |_| LodSettings::default());
    let (without, _) = scene.approach(WAY, |_| LodSettings { enabled: false, ..default() });
    // From the smallest level to the source at once, as nobody should.
    let level = |frame| if frame < FRAMES / 2 { 1 } else { 0 };
    let (hard, _) = scene.approach(WAY, |frame| LodSettings { fade: 0.0, force: Some(level(frame)), ..default() });
    let [worst, without, hard] = [with, without, hard].map(|differences| worst(&differences));
    println!(
        "levels {levels:?}; worst ratio {:.2} at frame {}, without levels {:.2}, with a hard switch {:.2} at frame {}",
        worst.1, worst.0, without.1, hard.1, hard.0
    );
    assert!(hard.0.abs_diff(FRAMES / 2) <= 1 && hard.1 > POP, "a hard switch is not seen: {hard:?}");
    assert!(levels.len() > 2 && levels.first() == Some(&1), "the way shows few levels: {levels:?}");
    assert!(worst.1 < POP, "frame {} pops: {:.2} times the difference of its neighbours", worst.0, worst.1);
}

/// The village with levels for its objects and for all of them, baked as in the example.
fn village() -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = village::write(folder.path());
    let file = format!("{}.meta", village::FILE);
    let meta = std::fs::read_to_string(folder.path().join(&file)).expect("was written");
    let overrides = parse_meta(&meta, &file).expect("valid").expect("settings");
    let settings = resolve(vec![Layer { origin: Origin::Meta { file }, overrides }]).expect("valid").settings;
    let source = Source { name: village::FILE, bytes: &bytes, resources: &NoResources };
    bake(&source, &settings, &Context::default()).expect("bakes").glb
}

#[test]
#[ignore = "draws 600 pictures of a village: needs a Vulkan driver, and minutes where that is software"]
#[expect(clippy::print_stdout, reason = "the figures")]
fn a_flight_to_a_village_does_not_pop() {
    // From where one mesh stands for all objects to the first houses.
    let way = (15.0 * village::RADIUS, 0.8 * village::RADIUS);
    let mut scene = Scene::new(village(), LodPlugin::default(), SIDE, true);
    let (with, levels) = scene.approach(way, |_| LodSettings::default());
    let (without, _) = scene.approach(way, |_| LodSettings { enabled: false, ..default() });
    let (hard, _) = scene.approach(way, |_| LodSettings { fade: 0.0, pixel_error: 8.0, ..default() });
    let [worst, without, hard] = [with, without, hard].map(|differences| worst(&differences));
    println!(
        "levels of all objects {levels:?}; worst ratio {:.2} at frame {}, without levels {:.2}, with coarse hard switches {:.2}",
        worst.1, worst.0, without.1, hard.1
    );
    assert!(levels.starts_with(&[1]) && levels.ends_with(&[0]), "the flight shows not both: {levels:?}");
    assert!(hard.1 > POP, "hard switches are not seen: {hard:?}");
    assert!(worst.1 < POP, "frame {} pops: {:.2} times the difference of its neighbours", worst.0, worst.1);
}

#[test]
#[ignore = "needs a Vulkan driver"]
#[expect(clippy::print_stdout, reason = "the figures")]
fn mipmaps_keep_distant_levels_from_sparkling() {
    let glb = octopus().glb;
    let [with, without] = [true, false].map(|mipmaps| {
        let mut scene = Scene::new(glb.clone(), LodPlugin { mipmaps, ..default() }, SIDE, true);
        let (differences, levels) = scene.approach(AFAR, |_| LodSettings::default());
        assert_eq!(levels, [1]);
        differences.iter().sum::<f64>() / differences.len() as f64
    });
    println!("mean difference of frames afar: {with:.3} with mipmaps, {without:.3} without");
    assert!(with < 0.9 * without, "{with} with mipmaps, {without} without");
}

#[test]
fn a_jump_is_found_where_it_is() {
    let mut differences: Vec<f64> = (0..30).map(|i| 1.0 + 0.01 * f64::from(i)).collect();
    assert!(worst(&differences).1 < 1.1);
    differences[20] *= 2.0;
    let (frame, ratio) = worst(&differences);
    assert!(frame == 21 && (ratio - 2.0).abs() < 0.05, "{ratio} at {frame}");
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn instances_of_a_level_batch() {
    let mut scene = Scene::new(octopus().glb, LodPlugin::default(), SIDE, false);
    let world = scene.app.world_mut();
    let handle = world.get::<WorldAssetRoot>(scene.model).expect("a model").0.clone();
    for i in 1..20 {
        world.spawn((WorldAssetRoot(handle.clone()), Transform::from_xyz(0.1 * i as f32, -0.2, 0.0)));
    }
    world.resource_mut::<LodSettings>().force = Some(1);
    world.entity_mut(scene.camera).insert(Transform::from_xyz(0.0, 0.0, 5.0));
    (0..50).for_each(|_| scene.app.update());
    assert_eq!(scene.app.world().resource::<LodStats>().levels[1].groups, 20);
    let phases = scene.app.sub_app(RenderApp).world().resource::<ViewBinnedRenderPhases<Opaque3d>>();
    let draws = |phase: &BinnedRenderPhase<Opaque3d>| {
        (phase.multidrawable_meshes.len() + phase.batchable_meshes.len(), phase.unbatchable_meshes.len())
    };
    assert_eq!(phases.values().map(draws).collect::<Vec<_>>(), [(1, 0)]);
}

/// The frame with the largest ratio between its difference and the median of its neighbours', and that ratio.
fn worst(differences: &[f64]) -> (usize, f64) {
    let ratio = |i: usize| {
        let near = i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(differences.len());
        let mut others: Vec<f64> = near.filter(|&k| k != i).map(|k| differences[k]).collect();
        others.sort_by(f64::total_cmp);
        differences[i] / others[others.len() / 2]
    };
    let ratios = (0..differences.len()).map(|i| (i + 1, ratio(i)));
    ratios.max_by(|a, b| a.1.total_cmp(&b.1)).expect("differences")
}

impl Scene {
    /// Moves the camera all the way, from one distance to another. Differences between successive frames, and the levels that were seen.
    fn approach(&mut self, way: (f32, f32), settings: impl Fn(usize) -> LodSettings) -> (Vec<f64>, Vec<u32>) {
        let (mut differences, mut levels) = (Vec::new(), Vec::new());
        let mut last: Option<Vec<u8>> = None;
        for frame in 0..FRAMES {
            let t = frame as f32 / (FRAMES - 1) as f32;
            // Each frame brings the model closer by the same factor.
            let distance = way.0 * (way.1 / way.0).powf(t);
            let place = Transform::from_translation(distance * Vec3::new(0.3, 0.35, 0.89).normalize());
            self.app.world_mut().resource_mut::<LodSettings>().set_if_neq(settings(frame));
            self.look_from(place.looking_at(Vec3::ZERO, Vec3::Y));
            let picture = self.picture();
            if let Some(last) = &last {
                differences.push(difference(last, &picture));
            }
            last = Some(picture);
            levels.extend(self.lods().map(|lods| lods.current));
        }
        levels.dedup();
        (differences, levels)
    }
}

/// Root of the mean squared difference of colours.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    let squared: f64 = a.iter().zip(b).map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2)).sum();
    (squared / a.len() as f64).sqrt()
}
