//! The game as it ships: it bakes nothing and looks at nothing but `imported_assets/`.
//!
//! ```sh
//! cargo run --example headless_bake -- shipping    # bakes everything with the profile `shipping`: without the sources
//! cargo run --example shipping                     # shows what was baked; `-- --screenshot DIR` for a picture
//! ```
//!
//! A game of your own has one `main.rs` for both (the README's quick start) and decides with a feature:
//!
//! ```toml
//! [features]
//! default = ["bake"]                  # cargo run: bakes when models are imported
//! bake = ["bevy_simpliguard/bake"]    # cargo build --release --no-default-features: ships
//!
//! [dependencies]
//! bevy_simpliguard = { path = "../simpliguard/crates/bevy_simpliguard", default-features = false }
//! ```
//!
//! Without `bake` Bevy has no asset processor and `AssetMode::Processed` reads `imported_assets/Default` as it is, and of the
//! plugin only the part remains that switches levels. A package is compiled with one set of features, and the other examples
//! of this one need `bake`, so here the same is said in code: that part alone, `LodPlugin`, and no processor.
//!
//! Besides the program, a game ships `imported_assets/Default/`. `source: Drop` in the profile leaves out the source's meshes
//! and textures; without it the source is level 0 and shown up close.

#[path = "shared/pictures.rs"]
mod pictures;

use std::path::Path;
use std::process::ExitCode;

use bevy::asset::AssetMode;
use bevy::asset::io::file::FileAssetReader;
use bevy::prelude::*;
use bevy_simpliguard::lod::LodPlugin;

use pictures::{Pictures, all_have_levels};

const MODELS: [&str; 4] = ["bed.glb", "octopus.glb", "pool_table.glb", "teddy_bear.glb"];

#[expect(clippy::print_stderr, reason = "a program's own message")]
fn main() -> ExitCode {
    let assets = AssetPlugin { mode: AssetMode::Processed, use_asset_processor_override: Some(false), ..default() };
    let baked = FileAssetReader::get_base_path().join(Path::new(&assets.processed_file_path));
    if let Some(model) = MODELS.iter().find(|model| !baked.join(model).is_file()) {
        eprintln!("{model} is not in {}: run the example headless_bake first", baked.display());
        return ExitCode::FAILURE;
    }
    let exit = App::new()
        .add_plugins((LodPlugin::default(), DefaultPlugins.set(assets)))
        .add_systems(Startup, setup)
        .picture("shipping", all_have_levels)
        .run();
    if exit.is_success() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn setup(mut commands: Commands, server: Res<AssetServer>) {
    commands.spawn((Camera3d::default(), Transform::from_xyz(0.0, 1.8, 5.0).looking_at(Vec3::Y * 0.2, Vec3::Y)));
    commands.spawn((DirectionalLight::default(), Transform::from_xyz(2.0, 4.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y)));
    for (model, [x, z]) in MODELS.into_iter().zip([[-1.8, 0.0], [-0.1, 1.5], [1.6, 0.0], [0.9, 1.8]]) {
        commands.spawn((WorldAssetRoot(server.load(format!("{model}#Scene0"))), Transform::from_xyz(x, 0.0, z)));
    }
}
