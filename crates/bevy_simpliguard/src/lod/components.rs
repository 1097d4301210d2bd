//! What a game sees of the levels of detail: settings, the switch on each instance, and the groups behind it.

use bevy::ecs::entity::MapEntities;
use bevy::prelude::*;

use super::distance;

/// How levels of detail are chosen, for the whole app. May change at any time.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct LodSettings {
    /// Largest error of a level in view, in physical pixels, above 0. A level's error is the distance that 95 % of both
    /// surfaces, its own and the source's, stay within.
    ///
    /// The default is one pixel: a silhouette that moves by less is hidden by anti-aliasing. Games with many instances
    /// try 2 next.
    pub pixel_error: f32,
    /// Length of the cross-fade into a level as a fraction of the distance at which it starts, from 0 to 1. 0 switches at
    /// once, and saves the materials the `discard` that dithers a fade.
    pub fade: f32,
    /// Factor on all switching distances, above 0: 2 keeps each level twice as far as the pixel error asks.
    pub bias: f32,
    /// Whether levels are used at all; if not, every instance shows its source.
    pub enabled: bool,
    /// The level that every instance shows at any distance, numbered as in [`SimpliguardLods::force`], which it overrides.
    /// `None` leaves it to the instance.
    pub force: Option<u32>,
}

impl Default for LodSettings {
    fn default() -> Self {
        Self { pixel_error: 1.0, fade: 0.1, bias: 1.0, enabled: true, force: None }
    }
}

/// The levels of one model instance, on the entity with its [`WorldAssetRoot`].
///
/// It is added to every instance that has levels, in the `PostUpdate` of the frame the instance is spawned in. A game
/// that wants other values from the start spawns it with the instance; `force`, `bias` and `enabled` are kept when the
/// model is reloaded.
///
/// [`WorldAssetRoot`]: bevy::world_serialization::WorldAssetRoot
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Default, Clone)]
pub struct SimpliguardLods {
    /// The level to show at any distance: 0 is the source, `k` is `LOD<k>` of the file. Where the file has no such level
    /// the next more detailed one is shown. `None` chooses by distance.
    pub force: Option<u32>,
    /// Factor on the switching distances of this instance, above 0; it multiplies [`LodSettings::bias`].
    pub bias: f32,
    /// Whether this instance uses its levels; if not, it shows its source.
    pub enabled: bool,
    /// The level in view, numbered as in `force`; the more visible of two during a cross-fade. Written by the plugin.
    pub current: u32,
    /// The levels in falling detail, the source first unless the file was baked without it. Written by the plugin; empty
    /// while no model with levels is loaded.
    #[entities]
    pub levels: Vec<LodLevel>,
}

impl Default for SimpliguardLods {
    fn default() -> Self {
        Self { force: None, bias: 1.0, enabled: true, current: 0, levels: Vec::new() }
    }
}

/// One level of a model: what it costs, how far it is off, and what draws it.
#[derive(Reflect, MapEntities, Clone, Debug, PartialEq)]
pub struct LodLevel {
    /// Number in the file: 0 is the source, 1 has the smallest budget.
    pub level: u32,
    /// Most triangles that were asked for; of the source, the number it has.
    pub budget: u32,
    /// Triangles.
    pub faces: u32,
    /// Distance that 95 % of both surfaces, the source's and the level's, stay within, as a fraction of the diagonal of
    /// the source's bounding box. 0 for the source.
    pub error: f32,
    /// The primitives that draw it.
    #[entities]
    pub primitives: Vec<LodPrimitive>,
}

/// One mesh entity of a level.
#[derive(Reflect, MapEntities, Clone, Debug, PartialEq)]
pub struct LodPrimitive {
    /// The entity with the mesh.
    #[entities]
    pub entity: Entity,
    /// Its mesh, for colliders, picking and the like.
    pub mesh: Handle<Mesh>,
    /// Its triangles.
    pub faces: u32,
}

/// All levels of one instance, which switch together. Stands on the scene's own root entity, the child of the one with
/// [`SimpliguardLods`].
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub struct LodGroup {
    /// Centre of the bounding sphere in the space of this entity, in the rest pose: the point that distances are
    /// measured to.
    pub center: Vec3,
    /// Radius of the bounding sphere, half the diagonal of the bounding box.
    pub radius: f32,
    /// The levels in falling detail, the source first if the file holds it.
    #[entities]
    pub levels: Vec<LodLevel>,
}

impl LodGroup {
    /// The distance from a perspective camera to the centre, in world units, at which the level in place `slot` of
    /// `levels` starts to fade in. 0 for the first, which needs no distance.
    ///
    /// `scale` is the largest scale of the instance, `height` that of the viewport in physical pixels, `fov` the vertical
    /// field of view in radians. The bias of the instance is not in it.
    pub fn switch_distance(&self, slot: usize, scale: f32, height: f32, fov: f32, settings: &LodSettings) -> f32 {
        if slot == 0 {
            return 0.0;
        }
        let error = self.levels.iter().skip(1).take(slot).fold(0.0_f32, |worst, level| worst.max(level.error));
        let radius = self.radius * scale;
        let from_sphere = distance::switch_distance(2.0 * radius * error, height, fov, settings.pixel_error);
        from_sphere * settings.bias + radius
    }
}

/// Stands on every mesh entity of a [`LodGroup`], for picking and for glTF handlers that treat levels apart.
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub struct LodMember {
    /// The entity with the [`LodGroup`].
    #[entities]
    pub group: Entity,
    /// Number of the level: 0 is the source.
    pub level: u32,
}
