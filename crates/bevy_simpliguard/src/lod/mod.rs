//! Levels of detail in the running game. A baked file is loaded like any glTF, and its levels switch on their own.
//!
//! The game loads its models as usual:
//!
//! ```no_run
//! # use bevy::prelude::*;
//! # use bevy_simpliguard::lod::LodPlugin;
//! # use bevy::gltf::GltfAssetLabel;
//! # use bevy::world_serialization::WorldAssetRoot;
//! App::new()
//!     .add_plugins((DefaultPlugins, LodPlugin::default()))
//!     .add_systems(Startup, |mut commands: Commands, assets: Res<AssetServer>| {
//!         commands.spawn(WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset("model.glb"))));
//!     });
//! ```
//!
//! # How it works
//! While the file is loaded, a glTF handler spawns the level nodes, which are in no scene, under the root of the scene
//! and inserts a [`LodGroup`] there. Each frame, one system computes the size of each group on the screen, selects a
//! level by its measured error, and writes it into the [`VisibilityRange`]s of the group's mesh entities. The sizes are
//! those of the frame, so changes of zoom, window, render target and scale act at once.
//!
//! One selection is made for the whole group. So parts with different origins switch together. Source and level are
//! seen together only during a cross-fade, where they share the pixels. Shadows follow the same selection. `Visibility`
//! is not changed. Meshes and materials are those of the file, so instances of the same level are batched.
//!
//! [`SimpliguardLods`] on the root of an instance forces a level, changes its distances or switches its levels off. It
//! also lists the levels with their meshes. [`LodStats`] counts triangles and draw calls,
//! [`memory_of`] bytes on the GPU.
//!
//! # Limits
//! - With several active 3D cameras, all cameras show the level of the one that needs the most detail, whatever its
//!   render layers are.
//! - The bounding sphere is that of the rest pose. It moves with the entity of the instance, not with the root motion
//!   of a clip.
//! - A level stands for the whole scene. While a part of the source is hidden, but not the instance itself, the
//!   instance shows its source. If a game moves parts, or gives them other materials, the levels do not change.
//! - Levels morph with the weights of the source's node. In a file without the source they keep the default weights.
//! - Cross-fades need materials that dither for `VisibilityRange`s, as `StandardMaterial` does. With a camera that has
//!   a `DepthPrepass` and no other prepass, Bevy 0.19 writes opaque meshes into the depth buffer without dithering, so
//!   the background is seen through a fade. [`LodSettings::fade`] 0 switches fades off.
//!
//! [`VisibilityRange`]: bevy::camera::visibility::VisibilityRange

mod blocks;
mod bounds;
mod components;
mod cover;
mod distance;
mod fade;
mod file;
mod handler;
mod kept;
mod memory;
mod mipmaps;
pub mod on_demand;
mod stats;
mod switch;
#[cfg(test)]
mod tests;

use bevy::asset::AssetEventSystems;
use bevy::camera::CameraUpdateSystems;
use bevy::camera::visibility::VisibilitySystems;
use bevy::gltf::extensions::GltfExtensionHandlers;
use bevy::gltf::{DefaultGltfImageSampler, GltfPlugin};
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats};
use bevy::prelude::*;
use bevy::render::renderer::RenderAdapterInfo;
use bevy::tasks::block_on;
use bevy::transform::TransformSystems;
use wgpu_types::DeviceType;

pub use self::components::{LodGroup, LodLevel, LodMember, LodPrimitive, LodSettings, LodView, SimpliguardLods};
use self::handler::{LoaderDefaults, LodHandler};
pub use self::memory::{Memory, ModelMemory, memory_of};
use self::mipmaps::{Mipmaps, TextureOptions};
pub use self::on_demand::{OnDemand, OnDemandPart, SourceSettings, SourceStats};
use self::on_demand::{Presence, Residency};
pub use self::stats::{LodLevelStats, LodStats};

/// The anisotropy of filters on graphics cards.
const ANISOTROPY: u16 = 8;

/// Switches the levels of baked glTF files. It needs Bevy's `GltfPlugin` and may be added before or after it.
#[derive(Clone, Debug)]
pub struct LodPlugin {
    /// The first value of the resource [`LodSettings`].
    pub settings: LodSettings,
    /// True if the textures of levels, and those of their source, get mipmaps when they are loaded, so that nothing
    /// sparkles afar, and a switch does not change the look. Textures whose own sampler asks for no mipmaps get none.
    /// Mipmaps need a third more memory, and the textures are decoded a second time, on the threads of Bevy's
    /// `AsyncComputeTaskPool`. Textures in blocks of BC7 have their mipmaps in the file; they are decoded only for a GPU that
    /// does not take them. All are filtered with the sampler of Bevy's `GltfPlugin`.
    pub mipmaps: bool,
    /// Largest anisotropy of the filter of mipmaps, from 1 (none: surfaces that are seen at a grazing angle blur) to 16.
    /// `None` stands for 8, and for 1 where the renderer runs in software: such filters take most of its time.
    /// Where the sampler of Bevy's `GltfPlugin` is anisotropic, its own counts.
    pub anisotropy: Option<u16>,
}

impl Default for LodPlugin {
    fn default() -> Self {
        Self { settings: LodSettings::default(), mipmaps: true, anisotropy: None }
    }
}

/// The systems that switch levels, in `PostUpdate` between the propagation of transforms and the check of visibility.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LodSystems;

impl Plugin for LodPlugin {
    fn build(&self, app: &mut App) {
        on_demand::register(app);
        app.insert_resource(self.settings.clone())
            .init_resource::<LodStats>()
            .init_resource::<SourceSettings>()
            .init_resource::<SourceStats>()
            .init_resource::<Residency>()
            .register_type::<LodSettings>()
            .register_type::<LodStats>()
            .register_type::<SimpliguardLods>()
            .register_type::<LodGroup>()
            .register_type::<LodMember>()
            .register_type::<OnDemand>()
            .register_type::<Presence>()
            .register_type::<SourceSettings>()
            .register_type::<SourceStats>()
            .configure_sets(
                PostUpdate,
                LodSystems
                    .after(TransformSystems::Propagate)
                    .after(CameraUpdateSystems)
                    .after(AssetEventSystems)
                    .after(VisibilitySystems::VisibilityPropagate)
                    .before(VisibilitySystems::CheckVisibility),
            )
            .add_systems(
                PostUpdate,
                (switch::attach, switch::note_hidden_parts, on_demand::update, switch::switch_levels)
                    .chain()
                    .in_set(LodSystems),
            )
            .add_systems(PostUpdate, stats::count.after(VisibilitySystems::MarkNewlyHiddenEntitiesInvisible))
            .add_observer(switch::detach);
    }

    /// Registers the glTF handler, when the handlers of all other plugins are known: they give the levels their
    /// materials.
    fn cleanup(&self, app: &mut App) {
        on_demand::open(app);
        let defaults = app.get_added_plugins::<GltfPlugin>().first().map(|gltf| LoaderDefaults {
            convert_coordinates: gltf.convert_coordinates,
            bounds_policy: gltf.skinned_mesh_bounds_policy,
        });
        let Some(handlers) = app.world().get_resource::<GltfExtensionHandlers>() else {
            error!("no levels of detail: LodPlugin needs Bevy's GltfPlugin (or DefaultPlugins)");
            return;
        };
        let formats = app.world().get_resource::<CompressedImageFormatSupport>();
        let formats = formats.map_or(CompressedImageFormats::NONE, |support| support.0);
        let adapter = app.world().get_resource::<RenderAdapterInfo>().map(|adapter| adapter.device_type);
        let anisotropy = self.anisotropy.unwrap_or(default_anisotropy(adapter));
        let options = TextureOptions { mipmaps: self.mipmaps, anisotropy, formats };
        let sampler = app.world().get_resource::<DefaultGltfImageSampler>();
        let mipmaps = sampler.map(|sampler| Mipmaps::new(sampler.get_internal(), options));
        let mut handlers = block_on(handlers.0.write());
        let handler = LodHandler::new(handlers.clone(), defaults.unwrap_or_default(), mipmaps);
        handlers.push(Box::new(handler));
    }
}

/// The anisotropy of filters on an adapter. `None` stands for a game without a renderer.
fn default_anisotropy(adapter: Option<DeviceType>) -> u16 {
    if adapter == Some(DeviceType::Cpu) { 1 } else { ANISOTROPY }
}
