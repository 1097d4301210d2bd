//! A model with levels, drawn by Bevy into a picture without a window. Needs a Vulkan driver; one in software will do.

use std::path::Path;
use std::time::Duration;

use bevy::app::PluginGroupBuilder;
use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::camera::RenderTarget;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_resource::TextureFormat;
use bevy::render::settings::{WgpuFeatures, WgpuSettings};
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use bevy_simpliguard::lod::{LodPlugin, LodSettings, SimpliguardLods, on_demand};
use simpliguard::gltf::Divided;
use simpliguard::settings::{BakeSettings, Quality};
use simpliguard::{Baked, Context, NoResources, Source, bake};

/// Where the model stands: the octopus is then in the middle.
pub(crate) const PLACE: Vec3 = Vec3::new(0.0, -0.2, 0.0);

/// The octopus with its levels.
pub(crate) fn octopus() -> Baked {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/octopus.glb")).expect("in the repository");
    let source = Source { name: "octopus", bytes: &bytes, resources: &NoResources };
    let settings = BakeSettings { normal_map: false, ..BakeSettings::preset(Quality::Draft) };
    bake(&source, &settings, &Context::default()).expect("bakes")
}

/// An app that draws a model into a picture, without a window.
pub(crate) struct Scene {
    pub(crate) app: App,
    target: Handle<Image>,
    pub(crate) camera: Entity,
    pub(crate) model: Entity,
}

#[derive(Resource, Default)]
struct Captured(Option<Vec<u8>>);

impl Scene {
    /// Pictures have a side of `side` pixels. Only where it is not pipelined can the renderer's world be looked at.
    pub(crate) fn new(glb: Vec<u8>, levels: LodPlugin, side: u32, pipelined: bool) -> Self {
        let plugins = without_window();
        let plugins = if pipelined { plugins } else { plugins.disable::<PipelinedRenderingPlugin>() };
        Self::with(glb, levels, side, plugins)
    }

    /// As [`Self::new`], of a model whose source and levels are loaded on demand from other files.
    pub(crate) fn on_demand(model: Divided, side: u32) -> Self {
        let sources = Dir::default();
        for part in model.parts {
            sources.insert_asset(Path::new(&format!("model.glb/{}", part.name)), part.bytes);
        }
        let levels = (model.levels, Some(sources));
        Self::of_files(levels, LodPlugin::default(), side, without_window())
    }

    /// As [`Self::new`], on a GPU without these features.
    pub(crate) fn without(features: WgpuFeatures, glb: Vec<u8>, side: u32) -> Self {
        let settings = WgpuSettings { disabled_features: Some(features), ..default() };
        let render = RenderPlugin { render_creation: settings.into(), ..default() };
        Self::with(glb, LodPlugin::default(), side, without_window().set(render))
    }

    fn with(glb: Vec<u8>, levels: LodPlugin, side: u32, plugins: PluginGroupBuilder) -> Self {
        Self::of_files((glb, None), levels, side, plugins)
    }

    fn of_files(
        (glb, sources): (Vec<u8>, Option<Dir>),
        levels: LodPlugin,
        side: u32,
        plugins: PluginGroupBuilder,
    ) -> Self {
        let (mut app, dir) = (App::new(), Dir::default());
        dir.insert_asset(Path::new("model.glb"), glb);
        if let Some(sources) = sources {
            let reader = move || Box::new(MemoryAssetReader { root: sources.clone() }) as Box<_>;
            app.register_asset_source(on_demand::SOURCE, AssetSourceBuilder::new(reader));
        }
        app.register_asset_source(
            AssetSourceId::Default,
            AssetSourceBuilder::new(move || Box::new(MemoryAssetReader { root: dir.clone() })),
        );
        app.add_plugins((plugins, levels)).init_resource::<Captured>();
        app.finish();
        app.cleanup();
        let target = Image::new_target_texture(side, side, TextureFormat::Rgba8UnormSrgb, None);
        let world = app.world_mut();
        let target = world.resource_mut::<Assets<Image>>().add(target);
        let camera = world.spawn((Camera3d::default(), RenderTarget::Image(target.clone().into()))).id();
        world.spawn((DirectionalLight::default(), Transform::from_xyz(3.0, 4.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y)));
        let scene = world.resource::<AssetServer>().load("model.glb#Scene0");
        let model = world.spawn((WorldAssetRoot(scene), Transform::from_translation(PLACE))).id();
        let mut scene = Self { app, target, camera, model };
        while scene.lods().is_none_or(|lods| lods.levels.is_empty()) {
            scene.app.update();
            std::thread::sleep(Duration::from_millis(5));
        }
        scene.settle();
        scene
    }

    /// Shows every level for a while: pipelines are compiled and textures uploaded as they are needed.
    pub(crate) fn settle(&mut self) {
        for level in [0, 1, 2, 3] {
            self.force(Some(level));
            (0..20).for_each(|_| self.app.update());
        }
        self.force(None);
    }

    /// Shows this level from everywhere, or the one that the size asks for.
    pub(crate) fn force(&mut self, level: Option<u32>) {
        self.app.world_mut().resource_mut::<LodSettings>().force = level;
    }

    /// Moves the camera.
    pub(crate) fn look_from(&mut self, place: Transform) {
        self.app.world_mut().entity_mut(self.camera).insert(place);
    }

    pub(crate) fn lods(&self) -> Option<&SimpliguardLods> {
        self.app.world().get(self.model)
    }

    /// Four bytes a pixel.
    pub(crate) fn picture(&mut self) -> Vec<u8> {
        // The screenshot shows the frame that it is asked for in.
        let world = self.app.world_mut();
        world.spawn(Screenshot::image(self.target.clone())).observe(
            |shot: On<ScreenshotCaptured>, mut captured: ResMut<Captured>| captured.0 = shot.image.data.clone(),
        );
        loop {
            self.app.update();
            if let Some(picture) = self.app.world_mut().resource_mut::<Captured>().0.take() {
                return picture;
            }
        }
    }
}

pub(crate) fn without_window() -> PluginGroupBuilder {
    let window = WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
    DefaultPlugins.set(window).disable::<WinitPlugin>()
}
