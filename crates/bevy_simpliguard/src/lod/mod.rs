//! Levels of detail in the running game: a baked file is loaded as any glTF, and its levels switch by themselves.
//!
//! Nothing is to be done on the side of the game:
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
//! While the file is loaded, a glTF handler spawns the level nodes, which are in no scene, under the scene's root and
//! writes a [`LodGroup`] on it. Each frame, one system takes each group's size on the screen, chooses a level by its
//! measured error, and writes it into the [`VisibilityRange`]s of the group's mesh entities. Sizes are those of the frame,
//! so zoom, window, render target and scale are always up to date.
//!
//! All members of a group follow one choice, taken at one point: parts whose origins lie apart switch together, and source
//! and level are never seen together but in their cross-fade, where they share the pixels. Shadows follow the same choice.
//! `Visibility` is not touched. Meshes and materials are those of the file, so instances batch level by level.
//!
//! [`SimpliguardLods`] on an instance's root forces a level, shifts its distances or opts out, and lists the levels with
//! their meshes. [`LodStats`] counts triangles.
//!
//! # Limits
//! - With several active 3D cameras, all show the level of the one that asks for most detail, whatever render layers it has.
//! - The bounding sphere is that of the rest pose and moves with the instance's entity, not with a clip's root motion.
//! - A level stands for the whole scene. While a part of the source is hidden, or all of it but not the instance, the
//!   instance shows its source. Parts that a game moves or gives other materials do not change in the levels.
//! - Levels morph with the weights of the source's node; in a file without the source they keep the default ones.
//! - Cross-fades need materials that dither for `VisibilityRange`s as `StandardMaterial` does. Under a camera with a
//!   `DepthPrepass` and no other prepass, Bevy 0.19 writes opaque meshes into the depth buffer undithered, so a fade shows
//!   the background through. [`LodSettings::fade`] 0 does without fades.
//!
//! [`VisibilityRange`]: bevy::camera::visibility::VisibilityRange

mod bounds;
mod components;
mod distance;
mod fade;
mod file;
mod handler;
mod mipmaps;
mod stats;
mod switch;
#[cfg(test)]
mod tests;

use bevy::camera::CameraUpdateSystems;
use bevy::camera::visibility::VisibilitySystems;
use bevy::gltf::extensions::GltfExtensionHandlers;
use bevy::gltf::{DefaultGltfImageSampler, GltfPlugin};
use bevy::prelude::*;
use bevy::tasks::block_on;
use bevy::transform::TransformSystems;

pub use self::components::{LodGroup, LodLevel, LodMember, LodPrimitive, LodSettings, SimpliguardLods};
use self::handler::{LoaderDefaults, LodHandler};
use self::mipmaps::Mipmaps;
pub use self::stats::{LodLevelStats, LodStats};

/// Switches the levels of baked glTF files. It needs Bevy's `GltfPlugin` and may be added before or after it.
#[derive(Clone, Debug)]
pub struct LodPlugin {
    /// The first value of the resource [`LodSettings`].
    pub settings: LodSettings,
    /// Whether the textures of levels get mipmaps when they are loaded, so that levels in the distance do not sparkle. It
    /// costs a third more of their memory, and loading decodes them a second time, on the threads of Bevy's
    /// `AsyncComputeTaskPool`. They are filtered as the sampler of Bevy's `GltfPlugin` says.
    pub mipmaps: bool,
}

impl Default for LodPlugin {
    fn default() -> Self {
        Self { settings: LodSettings::default(), mipmaps: true }
    }
}

/// The systems that switch levels, in `PostUpdate` between the propagation of transforms and the check of visibility.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LodSystems;

impl Plugin for LodPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.settings.clone())
            .init_resource::<LodStats>()
            .register_type::<LodSettings>()
            .register_type::<LodStats>()
            .register_type::<SimpliguardLods>()
            .register_type::<LodGroup>()
            .register_type::<LodMember>()
            .configure_sets(
                PostUpdate,
                LodSystems
                    .after(TransformSystems::Propagate)
                    .after(CameraUpdateSystems)
                    .after(VisibilitySystems::VisibilityPropagate)
                    .before(VisibilitySystems::CheckVisibility),
            )
            .add_systems(
                PostUpdate,
                (switch::attach, switch::note_hidden_parts, switch::switch_levels).chain().in_set(LodSystems),
            )
            .add_systems(PostUpdate, stats::count.after(VisibilitySystems::MarkNewlyHiddenEntitiesInvisible))
            .add_observer(switch::detach);
    }

    /// Registers the glTF handler here, where those of all other plugins are known: they give the levels their materials.
    fn cleanup(&self, app: &mut App) {
        let defaults = app.get_added_plugins::<GltfPlugin>().first().map(|gltf| LoaderDefaults {
            convert_coordinates: gltf.convert_coordinates,
            bounds_policy: gltf.skinned_mesh_bounds_policy,
        });
        let Some(handlers) = app.world().get_resource::<GltfExtensionHandlers>() else {
            error!("no levels of detail: LodPlugin needs Bevy's GltfPlugin (or DefaultPlugins)");
            return;
        };
        let sampler = app.world().get_resource::<DefaultGltfImageSampler>().filter(|_| self.mipmaps);
        let mipmaps = sampler.map(|sampler| Mipmaps::new(sampler.get_internal()));
        let mut handlers = block_on(handlers.0.write());
        let handler = LodHandler::new(handlers.clone(), defaults.unwrap_or_default(), mipmaps);
        handlers.push(Box::new(handler));
    }
}
