//! Whole-app tests, without a window: groups made by hand, and combined files made by hand and loaded from memory.

mod glb;
mod morphs;
mod objects;
mod scenes;
mod skins;
mod switching;

use std::path::Path;

use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::camera::visibility::VisibleEntityRanges;
use bevy::camera::{CameraPlugin, ComputedCameraValues, RenderTargetInfo};
use bevy::gltf::{GltfAssetLabel, GltfPlugin};
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats};
use bevy::mesh::MeshPlugin;
use bevy::prelude::*;
use bevy::world_serialization::{WorldAssetRoot, WorldSerializationPlugin};
use wgpu_types::DeviceType;

use super::{ANISOTROPY, LodGroup, LodMember, LodPlugin, SimpliguardLods, default_anisotropy};

/// An app that draws nothing, and the folder its assets are in.
struct TestApp {
    app: App,
    dir: Dir,
}

impl TestApp {
    fn new() -> Self {
        Self::with(GltfPlugin::default(), |_| ())
    }

    fn with(gltf: GltfPlugin, prepare: impl FnOnce(&mut App)) -> Self {
        let (mut app, dir) = (App::new(), Dir::default());
        let root = dir.clone();
        app.register_asset_source(
            AssetSourceId::Default,
            AssetSourceBuilder::new(move || Box::new(MemoryAssetReader { root: root.clone() })),
        )
        .add_plugins((
            MinimalPlugins,
            TransformPlugin,
            LodPlugin::default(),
            AssetPlugin::default(),
            ImagePlugin::default(),
            MeshPlugin,
            CameraPlugin,
            WorldSerializationPlugin,
            gltf,
        ))
        .insert_resource(CompressedImageFormatSupport(CompressedImageFormats::NONE));
        prepare(&mut app);
        app.finish();
        app.cleanup();
        Self { app, dir }
    }

    fn world(&mut self) -> &mut World {
        self.app.world_mut()
    }

    /// A camera at `position` that looks along -z, with a right angle of view and a viewport 1000 pixels high.
    fn camera(&mut self, position: Vec3) -> Entity {
        let clip = Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_2, 1.0, 0.1);
        let camera = Camera { computed: computed(clip, 1000), ..default() };
        self.world().spawn((Camera3d::default(), camera, Transform::from_translation(position))).id()
    }

    fn place(&mut self, entity: Entity, position: Vec3) {
        self.world().get_mut::<Transform>(entity).expect("a transform").translation = position;
        self.app.update();
    }

    /// Levels with a part that `camera` has in range: number and parts, each level once.
    fn levels_in_range(&mut self, camera: Entity) -> Vec<(u32, usize)> {
        let world = self.app.world_mut();
        let mut members = world.query::<(Entity, &LodMember)>();
        let ranges = world.resource::<VisibleEntityRanges>();
        let mut counts = std::collections::BTreeMap::new();
        for (entity, member) in members.iter(world) {
            if ranges.entity_is_in_range_of_view(entity, camera) {
                *counts.entry(member.level).or_default() += 1;
            }
        }
        counts.into_iter().collect()
    }

    fn lods(&mut self, root: Entity) -> Mut<'_, SimpliguardLods> {
        self.world().get_mut::<SimpliguardLods>(root).expect("an instance with levels")
    }

    fn add_file(&self, name: &str, bytes: Vec<u8>) {
        self.dir.insert_asset(Path::new(name), bytes);
    }

    /// Spawns a scene of a file at `position`, and waits for it.
    fn spawn(&mut self, name: &str, scene: usize, position: Vec3) -> Entity {
        let label = GltfAssetLabel::Scene(scene).from_asset(name.to_owned());
        let handle = self.world().resource::<AssetServer>().load(label);
        let root = self.world().spawn((WorldAssetRoot(handle), Transform::from_translation(position))).id();
        self.update_until(|world| world.get::<Children>(root).is_some());
        self.app.update();
        root
    }

    /// Updates until `is_done`, as loading takes as many frames as it likes.
    fn update_until(&mut self, is_done: impl Fn(&World) -> bool) {
        for _ in 0..100_000 {
            self.app.update();
            if is_done(self.app.world()) {
                return;
            }
            std::thread::yield_now();
        }
        panic!("waited for something that does not happen");
    }

    /// The group of an instance and its entity.
    fn group(&mut self, root: Entity) -> (Entity, LodGroup) {
        let world = self.app.world();
        let children = world.get::<Children>(root).expect("a spawned scene");
        let found = children.iter().find_map(|child| Some((child, world.get::<LodGroup>(child)?.clone())));
        found.expect("a scene with levels")
    }
}

fn computed(clip_from_view: Mat4, height: u32) -> ComputedCameraValues {
    let target_info = Some(RenderTargetInfo { physical_size: UVec2::new(height, height), scale_factor: 1.0 });
    ComputedCameraValues { clip_from_view, target_info, ..default() }
}

#[test]
fn filters_are_isotropic_in_software() {
    for (adapter, anisotropy) in [
        (None, ANISOTROPY),
        (Some(DeviceType::DiscreteGpu), ANISOTROPY),
        (Some(DeviceType::IntegratedGpu), ANISOTROPY),
        (Some(DeviceType::Cpu), 1),
    ] {
        assert_eq!(default_anisotropy(adapter), anisotropy);
    }
}
