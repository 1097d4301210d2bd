//! Bakes all models of `assets/` as the game would, without a window or a graphics card, and ends: for continuous
//! integration and for what a game ships.
//!
//! ```sh
//! cargo run --example headless_bake                # exit code 1 if a model failed
//! cargo run --example headless_bake -- shipping    # with a profile of config/simpliguard.ron
//! ```
//!
//! `BakeMode::Blocking` makes Bevy's asset processor wait for each bake, so that it is done when all levels are. The results
//! lie in `imported_assets/` (see the example `shipping`) and in the cache, which a later job may be given.

use std::collections::BTreeSet;
use std::time::Duration;

use bevy::app::ScheduleRunnerPlugin;
use bevy::asset::AssetMode;
use bevy::asset::processor::AssetProcessor;
use bevy::gltf::GltfPlugin;
use bevy::image::ImagePlugin;
use bevy::log::LogPlugin;
use bevy::mesh::MeshPlugin;
use bevy::prelude::*;
use bevy::tasks::{IoTaskPool, Task};
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_simpliguard::{BakeFailed, BakeFinished, BakeMode, SimpliguardPlugin};

fn main() -> AppExit {
    App::new()
        .add_plugins((
            SimpliguardPlugin { mode: Some(BakeMode::Blocking), profile: std::env::args().nth(1), ..default() },
            MinimalPlugins.set(ScheduleRunnerPlugin::run_loop(Duration::from_millis(20))),
            LogPlugin { filter: "warn".into(), ..default() },
            AssetPlugin { mode: AssetMode::Processed, ..default() },
        ))
        // What the asset formats need; a renderer would bring some of it.
        .add_plugins((
            TransformPlugin,
            ImagePlugin::default(),
            MeshPlugin,
            WorldSerializationPlugin,
            GltfPlugin::default(),
        ))
        .init_resource::<Outcome>()
        .add_systems(Update, (report, finish).chain())
        .run()
}

/// The models that were baked or failed.
#[derive(Resource, Default)]
struct Outcome {
    baked: usize,
    failed: BTreeSet<String>,
}

#[expect(clippy::print_stdout, reason = "the program's result")]
fn report(
    mut outcome: ResMut<Outcome>,
    mut finished: MessageReader<BakeFinished>,
    mut failed: MessageReader<BakeFailed>,
) {
    for bake in finished.read() {
        let levels: Vec<_> = bake.report.levels.iter().map(|level| level.faces.to_string()).collect();
        let levels = match bake.report.objects.len() {
            0 => levels.join(", "),
            objects => format!("levels of {objects} kinds of objects"),
        };
        let seconds = bake.duration.as_secs_f32();
        println!("{}: {} triangles to {levels} in {seconds:.1} s", bake.path, bake.report.source_faces);
        outcome.baked += 1;
    }
    for bake in failed.read() {
        println!("{}: {}", bake.path, bake.error);
        outcome.failed.insert(bake.path.to_string());
    }
}

/// Ends when Bevy's asset processor has gone through all files, and with it all bakes.
#[expect(clippy::print_stdout, reason = "the program's result")]
fn finish(
    processor: Res<AssetProcessor>,
    outcome: Res<Outcome>,
    mut processing: Local<Option<Task<()>>>,
    mut frames_after: Local<u32>,
    mut exit: MessageWriter<AppExit>,
) {
    let processing = processing.get_or_insert_with(|| {
        let data = processor.data().clone();
        IoTaskPool::get().spawn(async move { data.wait_until_finished().await })
    });
    if processing.is_finished() {
        *frames_after += 1;
    }
    // What was told in the last moment arrives with the next frame.
    if *frames_after == 2 {
        println!(
            "{} baked, {} failed; the others were in the cache or up to date",
            outcome.baked,
            outcome.failed.len()
        );
        exit.write(if outcome.failed.is_empty() { AppExit::Success } else { AppExit::error() });
    }
}
