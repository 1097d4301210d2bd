//! Builds the LOD groups of a scene while Bevy's glTF loader builds the scene.
//!
//! Level nodes are in no scene, so the loader creates their meshes and materials but no entities. The handler spawns
//! them as the loader would do: levels of the whole scene under the root of the scene, which gets the [`LodGroup`], and
//! those of an object under the node in whose space they lie. The node of the object gets the group.
//!
//! A mesh entity of a level gets its material from the other glTF handlers, through the same hook as the source: from
//! the handler of bevy_pbr, so that this crate does not depend on it, and from those of a game with its own materials.
//! The hook is called on copies of the handlers in their first state. State that a handler has collected in other hooks
//! is missing there.

use std::collections::BTreeSet;
use std::sync::Arc;

use bevy::asset::LoadContext;
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::{DynamicSkinnedMeshBounds, NoFrustumCulling};
use bevy::gltf::convert_coordinates::GltfConvertCoordinates;
use bevy::gltf::extensions::{ErasedGltfExtensionHandler, GltfExtensionHandler};
use bevy::gltf::{
    GltfAssetLabel, GltfLoaderSettings, GltfMaterial, GltfMaterialName, GltfMeshName, GltfSkinnedMeshBoundsPolicy,
};
use bevy::mesh::MeshVertexAttribute;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::*;
use bevy::tasks::ConditionalSendFuture;

use super::bounds::{self, Bounds};
use super::components::{LodGroup, LodLevel, LodMember, LodPrimitive};
use super::fade::Show;
use super::file::{self, FileGroup, FileLevel, LodFile, Of};
use super::mipmaps::{self, Mipmaps};
use super::on_demand::{PartsOfFile, Presence, is_part};

/// Defaults of the loader settings that entities depend on. A file may override them.
#[derive(Clone, Copy, Default)]
pub(super) struct LoaderDefaults {
    pub(super) convert_coordinates: GltfConvertCoordinates,
    pub(super) bounds_policy: GltfSkinnedMeshBoundsPolicy,
}

/// The handler. Bevy clones it for each file.
#[derive(Clone)]
pub(super) struct LodHandler {
    others: Vec<Box<dyn ErasedGltfExtensionHandler>>,
    defaults: LoaderDefaults,
    /// Makes the images of textures. `None` without Bevy's own samplers.
    mipmaps: Option<Mipmaps>,
    /// The levels of the file that is being loaded, if it has any.
    file: Option<Arc<LodFile>>,
    /// The parts that are loaded on demand, if there are any.
    on_demand: Option<Arc<PartsOfFile>>,
    /// Box of the most detailed level of each group that is in the file, in the space of the levels.
    bounds: HashMap<usize, Bounds>,
    /// Entities of the nodes of the scene that is being built.
    entities: HashMap<usize, Entity>,
}

impl LodHandler {
    /// A handler. `others` give the levels their materials.
    pub(super) fn new(
        others: Vec<Box<dyn ErasedGltfExtensionHandler>>,
        defaults: LoaderDefaults,
        mipmaps: Option<Mipmaps>,
    ) -> Self {
        let (bounds, entities) = (HashMap::default(), HashMap::default());
        Self { others, defaults, mipmaps, file: None, on_demand: None, bounds, entities }
    }
}

impl GltfExtensionHandler for LodHandler {
    fn dyn_clone(&self) -> Box<dyn ErasedGltfExtensionHandler> {
        Box::new(self.clone())
    }

    fn on_root(&mut self, context: &mut LoadContext<'_>, gltf: &gltf::Gltf, settings: &GltfLoaderSettings) {
        let name = context.path().to_string();
        if !settings.load_meshes.is_empty() {
            self.defaults.convert_coordinates =
                settings.convert_coordinates.unwrap_or(self.defaults.convert_coordinates);
            self.defaults.bounds_policy = settings.skinned_mesh_bounds_policy.unwrap_or(self.defaults.bounds_policy);
            self.on_demand = PartsOfFile::of(&gltf.document).map(Arc::new);
            let is_away = |mesh| self.on_demand.as_ref().is_some_and(|parts| parts.has(mesh));
            self.file = LodFile::read(&gltf.document, &name, is_away).map(Arc::new);
        }
        if let Some(mipmaps) = &mut self.mipmaps {
            let has_levels = self.file.is_some() || is_part(&gltf.document);
            mipmaps.begin(&gltf.document, &name, settings, has_levels);
        }
    }

    /// Makes a second material for levels that are seen mirrored, as the loader does for meshes of the scene.
    fn on_material(
        &mut self,
        context: &mut LoadContext<'_>,
        material: &gltf::Material<'_>,
        handle: Handle<GltfMaterial>,
        asset: &GltfMaterial,
        _: &str,
    ) {
        let is_mirrored = |index: &usize| self.file.as_ref().is_some_and(|file| file.mirrored.contains(index));
        let Some(index) = material.index().filter(is_mirrored) else { return };
        // Culling neither side shows the same: levels are closed, or double-sided anyway.
        let inverted = GltfMaterial { cull_mode: None, ..asset.clone() };
        let label = GltfAssetLabel::Material { index, is_scale_inverted: true }.to_string();
        if context.has_labeled_asset(&label) {
            return;
        }
        for other in self.others.iter_mut() {
            other.on_material(context, material, handle.clone(), &inverted, &label);
        }
        context.add_labeled_asset(label, inverted);
    }

    fn on_gltf_primitive(
        &mut self,
        context: &mut LoadContext<'_>,
        _: &gltf::Gltf,
        mesh: &gltf::Mesh<'_>,
        primitive: &gltf::Primitive<'_>,
        buffers: &[Vec<u8>],
        _: &HashMap<Box<str>, MeshVertexAttribute>,
        _: bool,
        _: bool,
        _: &mut Option<Mesh>,
    ) -> impl ConditionalSendFuture<Output = ()> {
        if let Some(file) = self.file.clone() {
            let groups = file.by_mesh.get(&mesh.index()).into_iter().flatten();
            groups.for_each(|&group| self.extend_bounds(&file, group, primitive, buffers));
        }
        let images = self.mipmaps.as_mut().map(|mipmaps| mipmaps.start(&primitive.material(), buffers));
        async move {
            for (label, image) in images.into_iter().flatten() {
                if let Some(image) = image.await {
                    // Replaces the image of the loader.
                    context.add_labeled_asset(label.to_string(), image);
                }
            }
        }
    }

    fn on_gltf_node(&mut self, _: &mut LoadContext<'_>, node: &gltf::Node<'_>, entity: &mut EntityWorldMut<'_>) {
        if self.file.is_some() || self.on_demand.is_some() {
            self.entities.insert(node.index(), entity.id());
        }
    }

    fn on_scene_completed(
        &mut self,
        context: &mut LoadContext<'_>,
        _: &gltf::Scene<'_>,
        root: Entity,
        world: &mut World,
    ) {
        let entities = std::mem::take(&mut self.entities);
        let nodes: HashSet<usize> = entities.keys().copied().collect();
        let has_all = self.build_groups(context, root, world, entities);
        let Some(parts) = &self.on_demand else { return };
        let rotate_meshes = self.defaults.convert_coordinates.rotate_meshes;
        if let Some(on_demand) = parts.component(context, rotate_meshes, &nodes, has_all) {
            let presence = Presence::none(&on_demand);
            world.entity_mut(root).insert((on_demand, presence));
        }
    }
}

impl LodHandler {
    /// Builds the groups of a scene. Tells whether all that are in the file are there, with levels.
    fn build_groups(
        &mut self,
        context: &mut LoadContext<'_>,
        root: Entity,
        world: &mut World,
        entities: HashMap<usize, Entity>,
    ) -> bool {
        let Some(file) = self.file.clone() else { return false };
        // Levels stand for all nodes that they were made from. A scene with only some of these nodes, or the scene of a
        // single level, gets no group.
        let is_there = |group: &FileGroup| group.nodes().all(|node| entities.contains_key(node));
        let groups = file.groups.iter().enumerate().filter(|(_, group)| is_there(group));
        let groups: Vec<_> = groups.filter_map(|(i, group)| Some((group, *self.bounds.get(&i)?))).collect();
        let defaults = self.defaults;
        let mut builder = SceneBuilder {
            context,
            world,
            root,
            file: &file,
            on_demand: self.on_demand.as_deref(),
            entities,
            others: &mut self.others,
            defaults,
        };
        // The entities of all sources are found before levels become their neighbours.
        let of_objects = || groups.iter().map(|(group, _)| *group).filter(|group| group.of == Of::Object);
        let replaced: BTreeSet<usize> = of_objects().flat_map(|group| group.replaces.iter().copied()).collect();
        let objects: Vec<Entity> = of_objects().map(|group| builder.entities[&group.holder]).collect();
        let sources: Vec<_> = groups.iter().map(|(group, _)| builder.source(group, &replaced)).collect();
        let mut count = 0;
        for ((group, bounds), source) in groups.into_iter().zip(sources) {
            let objects = if group.of == Of::AllObjects { objects.clone() } else { Vec::new() };
            count += usize::from(builder.build(group, bounds, source, objects));
        }
        count == file.groups.len()
    }

    /// Extends the box of a group by a primitive of the level that [`FileGroup::of_bounds`] names.
    fn extend_bounds(&mut self, file: &LodFile, number: usize, primitive: &gltf::Primitive<'_>, buffers: &[Vec<u8>]) {
        let group = &file.groups[number];
        let Some(node) = file.node(group.of_bounds) else { return };
        let skinned = || {
            node.skin()?;
            bounds::skinned(&file.rest, file.space_of(group).inverse(), &node, primitive, buffers)
        };
        let bounds = skinned().unwrap_or_else(|| bounds::own(primitive));
        self.bounds.entry(number).and_modify(|known| *known = known.union(bounds)).or_insert(bounds);
    }
}

/// A scene that levels are added to.
struct SceneBuilder<'a, 'c> {
    context: &'a mut LoadContext<'c>,
    world: &'a mut World,
    root: Entity,
    file: &'a LodFile,
    /// The parts of the file that are loaded on demand, if there are any.
    on_demand: Option<&'a PartsOfFile>,
    /// Entities of the scene's nodes.
    entities: HashMap<usize, Entity>,
    others: &'a mut [Box<dyn ErasedGltfExtensionHandler>],
    defaults: LoaderDefaults,
}

/// The place of a group's levels.
#[derive(Clone, Copy)]
struct Place<'a> {
    file: &'a FileGroup,
    /// The entity with the [`LodGroup`].
    group: Entity,
    /// The entity in whose space the levels lie.
    parent: Entity,
    is_mirrored: bool,
}

impl SceneBuilder<'_, '_> {
    /// Builds a group. Tells whether it has levels.
    fn build(&mut self, file: &FileGroup, bounds: Bounds, source: Option<LodLevel>, objects: Vec<Entity>) -> bool {
        let entity = |node: usize| self.entities[&node];
        let place = Place {
            file,
            group: if file.of == Of::Object { entity(file.holder) } else { self.root },
            parent: file.space.map_or(self.root, entity),
            is_mirrored: file.is_mirrored(&self.file.rest),
        };
        let mut levels: Vec<LodLevel> = source.into_iter().collect();
        levels.extend(file.levels.iter().filter_map(|level| self.spawn_level(place, level)));
        if levels.iter().all(|level| level.level == 0) {
            return false;
        }
        for (slot, level) in levels.iter().enumerate() {
            let show = if slot == 0 { Show::Whole } else { Show::Nothing };
            let member = LodMember { group: place.group, level: level.level };
            for primitive in &level.primitives {
                self.world.entity_mut(primitive.entity).insert((member.clone(), show.range()));
            }
        }
        let (center, radius) = self.sphere(place, bounds);
        let object = if file.of == Of::Object { self.file.path(file.holder) } else { String::new() };
        self.world.entity_mut(place.group).insert(LodGroup { object, center, radius, levels, objects });
        true
    }

    /// Centre and radius of the bounding sphere in the space of the group's entity, in the rest pose.
    fn sphere(&self, place: Place<'_>, bounds: Bounds) -> (Vec3, f32) {
        if place.group == place.parent {
            return (bounds.center(), bounds.radius());
        }
        let (own, space) = (self.file.rest[place.file.holder], self.file.space_of(place.file));
        let largest = |matrix: Mat4| {
            [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(Vec4::length).into_iter().fold(0.0, f32::max)
        };
        let scale = largest(space) / largest(own);
        let center = (own.inverse() * space).transform_point3(bounds.center());
        if center.is_finite() && scale.is_finite() { (center, bounds.radius() * scale) } else { (Vec3::ZERO, f32::MAX) }
    }

    /// The source: the entities that the loader has spawned for the nodes in `replaces`. `None` if they have no meshes,
    /// because the file was baked without the source. Where levels stand for all objects, the objects are their source,
    /// and only what is not in `of_objects` is added.
    fn source(&mut self, group: &FileGroup, of_objects: &BTreeSet<usize>) -> Option<LodLevel> {
        let (mut primitives, mut textures) = (Vec::new(), Vec::new());
        let is_of_all = group.of == Of::AllObjects;
        for &index in group.replaces.iter().filter(|index| !is_of_all || !of_objects.contains(index)) {
            let children = self.world.get::<Children>(self.entities[&index]).map(|c| c.iter());
            let drawn = children.into_iter().flatten().filter_map(|c| Some((c, self.world.get::<Mesh3d>(c)?)));
            let mesh = self.file.node(index).and_then(|node| node.mesh());
            let faces = mesh.iter().flat_map(|mesh| self.faces(mesh));
            let primitive = |((entity, mesh), faces): ((Entity, &Mesh3d), u32)| LodPrimitive {
                entity,
                mesh: mesh.0.clone(),
                faces,
            };
            primitives.extend(drawn.zip(faces).map(primitive));
            textures.extend(mesh.iter().flat_map(|mesh| embedded_textures(mesh)));
        }
        let faces = primitives.iter().map(|p| p.faces).sum();
        let is_there = is_of_all || !primitives.is_empty();
        let textures = self.handles(textures);
        is_there.then_some(LodLevel { level: 0, budget: faces, faces, error: 0.0, primitives, textures })
    }

    /// Spawns a level. `None`, with a warning, if its joints are not in this scene.
    fn spawn_level(&mut self, place: Place<'_>, level: &FileLevel) -> Option<LodLevel> {
        let file = self.file;
        let node = file.node(level.node)?;
        let mesh = node.mesh()?;
        let skin = match node.skin().map(|skin| self.bind(&skin)) {
            Some(None) => {
                warn!(
                    "{}: LOD{} is left out, because its joints are not in its scene",
                    self.context.path(),
                    level.level
                );
                return None;
            }
            skin => skin.flatten(),
        };
        let member = LodMember { group: place.group, level: level.level };
        let spawn =
            |p: gltf::Primitive<'_>| self.spawn_primitive(place, (member.clone(), skin.clone()), (&node, &mesh, &p));
        let primitives = mesh.primitives().map(spawn).collect();
        let FileLevel { level, budget, faces, error, .. } = *level;
        let textures = self.handles(embedded_textures(&mesh));
        Some(LodLevel { level, budget, faces, error, primitives, textures })
    }

    /// The images of textures, each once.
    fn handles(&mut self, textures: impl IntoIterator<Item = usize>) -> Vec<Handle<Image>> {
        let unique: BTreeSet<usize> = textures.into_iter().collect();
        let label = |texture| GltfAssetLabel::Texture(texture).to_string();
        unique.into_iter().map(|texture| self.context.get_label_handle(label(texture))).collect()
    }

    /// The skin on this scene's joints.
    fn bind(&mut self, skin: &gltf::Skin<'_>) -> Option<SkinnedMesh> {
        let joints = skin.joints().map(|joint| self.entities.get(&joint.index()).copied()).collect::<Option<_>>()?;
        let label = GltfAssetLabel::InverseBindMatrices(skin.index());
        Some(SkinnedMesh { inverse_bindposes: self.context.get_label_handle(label.to_string()), joints })
    }

    /// The weights of the morph targets of a level: those of the source node with the same number of targets, so that
    /// clips morph both. The default weights if the file was baked without the source.
    fn morph_weights(
        &self,
        group: &FileGroup,
        mesh: &gltf::Mesh<'_>,
        primitive: &gltf::Primitive<'_>,
    ) -> Option<MeshMorphWeights> {
        let count = primitive.morph_targets().len();
        let has_as_many = |node: &gltf::Node<'_>| {
            node.mesh().is_some_and(|mesh| mesh.primitives().any(|p| p.morph_targets().len() == count))
        };
        let mut replaced = group.replaces.iter().filter_map(|&index| self.file.node(index));
        let driver = || self.entities.get(&replaced.find(has_as_many)?.index()).copied();
        let at_rest = || MeshMorphWeights::Value { weights: mesh.weights().unwrap_or_default().to_vec() };
        (count > 0).then(driver).map(|driver| driver.map_or_else(at_rest, MeshMorphWeights::Reference))
    }

    /// Spawns a primitive of a level in its place, with all components that the loader would insert.
    /// Inserts [`LodMember`] before other handlers are called, so that they can tell the level from the source.
    fn spawn_primitive(
        &mut self,
        place: Place<'_>,
        (member, skin): (LodMember, Option<SkinnedMesh>),
        (node, mesh, primitive): (&gltf::Node<'_>, &gltf::Mesh<'_>, &gltf::Primitive<'_>),
    ) -> LodPrimitive {
        let label = GltfAssetLabel::Primitive { mesh: mesh.index(), primitive: primitive.index() };
        let handle: Handle<Mesh> = self.context.get_label_handle(label.to_string());
        let material = primitive.material();
        let name = format!("{}.{}", node.name().unwrap_or("LOD"), primitive.index());
        let rotation = mesh_rotation(self.defaults.convert_coordinates);
        let weights = self.morph_weights(place.file, mesh, primitive);
        let mut entity = self.world.spawn((
            Mesh3d(handle.clone()),
            Transform::from_rotation(rotation),
            aabb(bounds::own(primitive), rotation),
            Name::new(name),
            ChildOf(place.parent),
            member,
        ));
        if let Some(skin) = skin {
            entity.insert(skin);
            match self.defaults.bounds_policy {
                GltfSkinnedMeshBoundsPolicy::Dynamic => entity.insert(DynamicSkinnedMeshBounds),
                GltfSkinnedMeshBoundsPolicy::NoFrustumCulling => entity.insert(NoFrustumCulling),
                GltfSkinnedMeshBoundsPolicy::BindPose => &mut entity,
            };
        }
        if let Some(weights) = weights {
            entity.insert(weights);
        }
        if let Some(name) = mesh.name() {
            entity.insert(GltfMeshName(name.to_owned()));
        }
        if let Some(name) = material.name() {
            entity.insert(GltfMaterialName(name.to_owned()));
        }
        let label = match material.index() {
            Some(index) => GltfAssetLabel::Material { index, is_scale_inverted: place.is_mirrored },
            None => GltfAssetLabel::DefaultMaterial,
        };
        let label = label.to_string();
        for other in self.others.iter_mut() {
            other.on_spawn_mesh_and_material(self.context, primitive, mesh, &material, &mut entity, &label);
        }
        LodPrimitive { entity: entity.id(), mesh: handle, faces: self.faces(mesh)[primitive.index()] }
    }

    /// The triangles of each primitive of a mesh, also where it is loaded on demand.
    fn faces(&self, mesh: &gltf::Mesh<'_>) -> Vec<u32> {
        let primitives = mesh.primitives();
        let on_demand = self.on_demand.and_then(|parts| parts.faces(mesh.index()));
        match on_demand.filter(|faces| faces.len() == primitives.len()) {
            Some(faces) => faces.to_vec(),
            None => primitives.map(|primitive| file::faces(&primitive)).collect(),
        }
    }
}

/// The textures of a mesh whose images are in the file: these have a label.
fn embedded_textures(mesh: &gltf::Mesh<'_>) -> Vec<usize> {
    let all = mesh.primitives().flat_map(|primitive| mipmaps::textures(&primitive.material()));
    let embedded = all.filter(|(texture, _)| matches!(texture.source().source(), gltf::image::Source::View { .. }));
    embedded.map(|(texture, _)| texture.index()).collect()
}

/// The rotation of mesh entities. A loader that turns meshes to Bevy's forward direction gives their entities a half
/// turn in return.
fn mesh_rotation(convert: GltfConvertCoordinates) -> Quat {
    if convert.rotate_meshes { Quat::from_xyzw(0.0, 1.0, 0.0, 0.0) } else { Quat::IDENTITY }
}

/// The box of a mesh after a rotation, which is the identity or a half turn about y.
fn aabb(bounds: Bounds, rotation: Quat) -> Aabb {
    let (a, b) = (rotation * bounds.min, rotation * bounds.max);
    Aabb::from_min_max(a.min(b), a.max(b))
}
