//! The levels of detail as a game sees them: settings, the component on each instance, and the groups behind it.

use bevy::ecs::entity::MapEntities;
use bevy::prelude::*;

use super::distance;

/// Settings of the selection of levels, for the whole app. They may change at any time.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct LodSettings {
    /// Largest error of a level in view, in physical pixels, above 0. The error of a level is the distance that 95 % of
    /// both surfaces, its own and the source's, stay within.
    ///
    /// The default is one pixel: anti-aliasing hides smaller changes of a silhouette. For games with many instances, 2
    /// is the next value to try.
    pub pixel_error: f32,
    /// Length of the cross-fade into a level, as a fraction of the distance at which it starts, from 0 to 1. 0 switches
    /// at once. Materials then need no `discard` for the dithering.
    pub fade: f32,
    /// Factor on all switching distances, above 0. With 2, each level is kept twice as far as `pixel_error` asks.
    pub bias: f32,
    /// True if levels are used. If not, every instance shows its source.
    pub enabled: bool,
    /// The level that every instance shows at any distance, numbered as in [`SimpliguardLods::force`], which it
    /// overrides. `None` leaves the selection to the instance.
    pub force: Option<u32>,
}

impl Default for LodSettings {
    fn default() -> Self {
        Self { pixel_error: 1.0, fade: 0.1, bias: 1.0, enabled: true, force: None }
    }
}

/// The levels of one model instance, on the entity with its [`WorldAssetRoot`]. In a scene that was baked with `scope:
/// Objects`, each object has its own, on the entity of its node. Then `force`, `bias` and `enabled` of the entity with
/// the [`WorldAssetRoot`], if a game gives it this component, are for all objects of the scene. The levels of that entity
/// are those that stand for all objects, if the scene was baked with `whole`; a level that is forced is always shown by
/// the objects themselves.
///
/// It is added to every instance that has levels, in the `PostUpdate` of the frame in which the instance is spawned. A
/// game that needs other values from the start spawns it with the instance. `force`, `bias` and `enabled` are kept when
/// the model is reloaded.
///
/// [`WorldAssetRoot`]: bevy::world_serialization::WorldAssetRoot
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Default, Clone)]
pub struct SimpliguardLods {
    /// The level to show at any distance: 0 is the source, `k` is `LOD<k>` of the file. If the file has no such level,
    /// the next more detailed one is shown. `None` selects by distance.
    pub force: Option<u32>,
    /// Factor on the switching distances of this instance, above 0. It multiplies [`LodSettings::bias`].
    pub bias: f32,
    /// True if this instance uses its levels. If not, it shows its source.
    pub enabled: bool,
    /// The level in view, numbered as in `force`. During a cross-fade, the one with more pixels. Written by the plugin.
    pub current: u32,
    /// The levels in falling detail. The source is the first, unless the file was baked without it. Written by the
    /// plugin. Empty while no model with levels is loaded.
    #[entities]
    pub levels: Vec<LodLevel>,
}

impl Default for SimpliguardLods {
    fn default() -> Self {
        Self { force: None, bias: 1.0, enabled: true, current: 0, levels: Vec::new() }
    }
}

/// One level of a model: its triangles, its error and its mesh entities.
#[derive(Reflect, MapEntities, Clone, Debug, PartialEq)]
pub struct LodLevel {
    /// Number in the file: 0 is the source, 1 has the smallest budget.
    pub level: u32,
    /// Largest number of triangles that was allowed. For the source, the number of its triangles.
    pub budget: u32,
    /// Number of triangles.
    pub faces: u32,
    /// Distance that 95 % of both surfaces, the source's and the level's, stay within, as a fraction of the diagonal of
    /// the source's bounding box. 0 for the source.
    pub error: f32,
    /// The mesh entities that draw it.
    #[entities]
    pub primitives: Vec<LodPrimitive>,
    /// The textures of its materials that are embedded in the file.
    pub textures: Vec<Handle<Image>>,
}

/// One mesh entity of a level.
#[derive(Reflect, MapEntities, Clone, Debug, PartialEq)]
pub struct LodPrimitive {
    /// The entity with the mesh.
    #[entities]
    pub entity: Entity,
    /// Its mesh, for colliders, picking and so on.
    pub mesh: Handle<Mesh>,
    /// Number of its triangles.
    pub faces: u32,
}

/// All levels of one instance, which switch together. It is on the root entity of the scene, a child of the entity with
/// [`SimpliguardLods`]. That of an object is on the entity of the object's node, beside its [`SimpliguardLods`].
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub struct LodGroup {
    /// The path of the object in its scene: the names of its node and of all above it, with `/` between them, such as
    /// `House/Door`. The second node of a name below one parent is `Door#2`. Empty if the levels stand for a whole scene.
    pub object: String,
    /// Centre of the bounding sphere in the space of this entity, in the rest pose. Distances are measured to it.
    pub center: Vec3,
    /// Radius of the bounding sphere, half the diagonal of the bounding box.
    pub radius: f32,
    /// The levels in falling detail. The source is the first if the file contains it.
    #[entities]
    pub levels: Vec<LodLevel>,
    /// The entities with the groups of all objects, if the levels of this one stand for all of them. Its first level then
    /// has only what belongs to no object with levels.
    #[entities]
    pub objects: Vec<Entity>,
}

impl LodGroup {
    /// The distance from a perspective camera to the centre, in world units, at which the level with the index `slot`
    /// in `levels` starts to fade in. 0 for the first level.
    ///
    /// `scale` is the largest scale of the instance. The bias of the instance is not included.
    pub fn switch_distance(&self, slot: usize, scale: f32, view: LodView, settings: &LodSettings) -> f32 {
        if slot == 0 {
            return 0.0;
        }
        let error = self.levels.iter().skip(1).take(slot).fold(0.0_f32, |worst, level| worst.max(level.error));
        let radius = self.radius * scale;
        let from_sphere = distance::switch_distance(2.0 * radius * error, view.height, view.fov, settings.pixel_error);
        from_sphere * settings.bias + radius
    }
}

/// The view of a perspective camera, for [`LodGroup::switch_distance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LodView {
    /// Height of the viewport in physical pixels.
    pub height: f32,
    /// Vertical field of view in radians.
    pub fov: f32,
}

/// Marks every mesh entity of a [`LodGroup`], for picking and for glTF handlers that treat levels differently.
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub struct LodMember {
    /// The entity with the [`LodGroup`].
    #[entities]
    pub group: Entity,
    /// Number of the level: 0 is the source.
    pub level: u32,
}
