//! Builds the LOD group of a scene while Bevy's glTF loader builds the scene.
//!
//! Level nodes are in no scene, so the loader makes their meshes and materials but no entities. The handler spawns them
//! under the scene's root, as the loader would, and writes [`LodGroup`] on that root.
//!
//! A level's mesh entity gets its material from the other glTF handlers, through the same hook as the source's: that of
//! bevy_pbr, so that this crate need not depend on it, and those of a game with materials of its own. They are asked on
//! copies in their first state: what a handler remembered of the file in other hooks, it does not know there.

use std::sync::Arc;

use bevy::asset::LoadContext;
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::{DynamicSkinnedMeshBounds, NoFrustumCulling};
use bevy::gltf::convert_coordinates::GltfConvertCoordinates;
use bevy::gltf::extensions::{ErasedGltfExtensionHandler, GltfExtensionHandler};
use bevy::gltf::{GltfAssetLabel, GltfLoaderSettings, GltfMaterialName, GltfMeshName, GltfSkinnedMeshBoundsPolicy};
use bevy::mesh::MeshVertexAttribute;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::tasks::ConditionalSendFuture;

use super::bounds::{self, Bounds};
use super::components::{LodGroup, LodLevel, LodMember, LodPrimitive};
use super::fade::Show;
use super::file::{self, FileLevel, LodFile};
use super::mipmaps::Mipmaps;

/// Settings of the loader that a file may override and that entities depend on.
#[derive(Clone, Copy, Default)]
pub(super) struct LoaderDefaults {
    pub(super) convert_coordinates: GltfConvertCoordinates,
    pub(super) bounds_policy: GltfSkinnedMeshBoundsPolicy,
}

/// The handler. Bevy clones it for each file it loads.
#[derive(Clone)]
pub(super) struct LodHandler {
    others: Vec<Box<dyn ErasedGltfExtensionHandler>>,
    defaults: LoaderDefaults,
    /// For the textures of levels, unless they are to have none.
    mipmaps: Option<Mipmaps>,
    /// The levels of the file being loaded, if it has any.
    file: Option<Arc<LodFile>>,
    /// Box of the most detailed level in scene space.
    bounds: Option<Bounds>,
    /// Nodes of the scene being built.
    entities: HashMap<usize, Entity>,
}

impl LodHandler {
    /// A handler that has `others` dress the levels.
    pub(super) fn new(
        others: Vec<Box<dyn ErasedGltfExtensionHandler>>,
        defaults: LoaderDefaults,
        mipmaps: Option<Mipmaps>,
    ) -> Self {
        Self { others, defaults, mipmaps, file: None, bounds: None, entities: HashMap::default() }
    }
}

impl GltfExtensionHandler for LodHandler {
    fn dyn_clone(&self) -> Box<dyn ErasedGltfExtensionHandler> {
        Box::new(self.clone())
    }

    fn on_root(&mut self, context: &mut LoadContext<'_>, gltf: &gltf::Gltf, settings: &GltfLoaderSettings) {
        if settings.load_meshes.is_empty() {
            return;
        }
        self.defaults.convert_coordinates = settings.convert_coordinates.unwrap_or(self.defaults.convert_coordinates);
        self.defaults.bounds_policy = settings.skinned_mesh_bounds_policy.unwrap_or(self.defaults.bounds_policy);
        if let Some(mipmaps) = &mut self.mipmaps {
            mipmaps.begin(settings);
        }
        self.file = LodFile::read(&gltf.document, &context.path().to_string()).map(Arc::new);
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
        if let Some(file) = &self.file
            && let Some(node) = file.levels.first().and_then(|level| file.node(level.node))
            && node.mesh().is_some_and(|m| m.index() == mesh.index())
        {
            let skinned = bounds::skinned(&file.document, &node, primitive, buffers);
            let bounds = skinned.unwrap_or_else(|| bounds::own(primitive));
            self.bounds = Some(self.bounds.map_or(bounds, |b| b.union(bounds)));
        }
        let levels = self.file.iter().flat_map(|file| file.levels.iter().filter_map(|level| file.node(level.node)));
        let is_level = levels.filter_map(|node| node.mesh()).any(|m| m.index() == mesh.index());
        let images = self.mipmaps.as_mut().filter(|_| is_level).map(|m| m.start(&primitive.material(), buffers));
        async move {
            for (label, image) in images.into_iter().flatten() {
                if let Some(image) = image.await {
                    // In place of what the loader made of it.
                    context.add_labeled_asset(label.to_string(), image);
                }
            }
        }
    }

    fn on_gltf_node(&mut self, _: &mut LoadContext<'_>, node: &gltf::Node<'_>, entity: &mut EntityWorldMut<'_>) {
        if self.file.is_some() {
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
        let (Some(file), Some(bounds)) = (self.file.clone(), self.bounds) else { return };
        // Only the whole that the levels were made from: not a scene of some of its nodes, nor a level's own scene.
        if !std::iter::once(&file.holder).chain(&file.replaces).all(|node| entities.contains_key(node)) {
            return;
        }
        let defaults = self.defaults;
        let builder = SceneBuilder { context, world, root, file: &file, entities, others: &mut self.others, defaults };
        builder.build(bounds);
    }
}

/// A scene to which levels are added.
struct SceneBuilder<'a, 'c> {
    context: &'a mut LoadContext<'c>,
    world: &'a mut World,
    root: Entity,
    file: &'a LodFile,
    /// Entities of the scene's nodes.
    entities: HashMap<usize, Entity>,
    others: &'a mut [Box<dyn ErasedGltfExtensionHandler>],
    defaults: LoaderDefaults,
}

impl SceneBuilder<'_, '_> {
    fn build(mut self, bounds: Bounds) {
        let mut levels: Vec<LodLevel> = self.source().into_iter().collect();
        levels.extend(self.file.levels.iter().filter_map(|level| self.spawn_level(level)));
        if levels.iter().all(|level| level.level == 0) {
            return;
        }
        for (slot, level) in levels.iter().enumerate() {
            let show = if slot == 0 { Show::Whole } else { Show::Nothing };
            let member = LodMember { group: self.root, level: level.level };
            for primitive in &level.primitives {
                self.world.entity_mut(primitive.entity).insert((member.clone(), show.range()));
            }
        }
        let group = LodGroup { center: bounds.center(), radius: bounds.radius(), levels };
        self.world.entity_mut(self.root).insert(group);
    }

    /// What the loader made of the nodes in `replaces`. `None` if they have no meshes: the source was left out.
    fn source(&self) -> Option<LodLevel> {
        let mut primitives = Vec::new();
        for &index in &self.file.replaces {
            let children = self.world.get::<Children>(self.entities[&index]).map(|c| c.iter());
            let drawn = children.into_iter().flatten().filter_map(|c| Some((c, self.world.get::<Mesh3d>(c)?)));
            let mesh = self.file.node(index).and_then(|node| node.mesh());
            let faces = mesh.iter().flat_map(|mesh| mesh.primitives()).map(|p| file::faces(&p));
            let primitive = |((entity, mesh), faces): ((Entity, &Mesh3d), u32)| LodPrimitive {
                entity,
                mesh: mesh.0.clone(),
                faces,
            };
            primitives.extend(drawn.zip(faces).map(primitive));
        }
        let faces = primitives.iter().map(|p| p.faces).sum();
        let is_there = !primitives.is_empty();
        is_there.then_some(LodLevel { level: 0, budget: faces, faces, error: 0.0, primitives })
    }

    /// Spawns a level; `None`, with a warning, if its joints are not in this scene.
    fn spawn_level(&mut self, level: &FileLevel) -> Option<LodLevel> {
        let file = self.file;
        let node = file.node(level.node)?;
        let mesh = node.mesh()?;
        let skin = match node.skin().map(|skin| self.bind(&skin)) {
            Some(None) => {
                warn!(
                    "{}: LOD{} hangs on joints outside of its scene and is left out",
                    self.context.path(),
                    level.level
                );
                return None;
            }
            skin => skin.flatten(),
        };
        let member = LodMember { group: self.root, level: level.level };
        let spawn = |p: gltf::Primitive<'_>| self.spawn_primitive((member.clone(), skin.clone()), &node, &mesh, &p);
        let primitives = mesh.primitives().map(spawn).collect();
        let FileLevel { level, budget, faces, error, .. } = *level;
        Some(LodLevel { level, budget, faces, error, primitives })
    }

    /// The skin on this scene's joints.
    fn bind(&mut self, skin: &gltf::Skin<'_>) -> Option<SkinnedMesh> {
        let joints = skin.joints().map(|joint| self.entities.get(&joint.index()).copied()).collect::<Option<_>>()?;
        let label = GltfAssetLabel::InverseBindMatrices(skin.index());
        Some(SkinnedMesh { inverse_bindposes: self.context.get_label_handle(label.to_string()), joints })
    }

    /// What weights the morph targets of a level: the node of the source that has as many, so that clips morph both, or
    /// the default weights for ever if the source was left out.
    fn morph_weights(&self, mesh: &gltf::Mesh<'_>, primitive: &gltf::Primitive<'_>) -> Option<MeshMorphWeights> {
        let count = primitive.morph_targets().len();
        let has_as_many = |node: &gltf::Node<'_>| {
            node.mesh().is_some_and(|mesh| mesh.primitives().any(|p| p.morph_targets().len() == count))
        };
        let mut replaced = self.file.replaces.iter().filter_map(|&index| self.file.node(index));
        let driver = || self.entities.get(&replaced.find(has_as_many)?.index()).copied();
        let at_rest = || MeshMorphWeights::Value { weights: mesh.weights().unwrap_or_default().to_vec() };
        (count > 0).then(driver).map(|driver| driver.map_or_else(at_rest, MeshMorphWeights::Reference))
    }

    /// Spawns a primitive of a level under the scene's root, with all that the loader would give it. It is a member
    /// before other handlers see it, so that they can tell it from the source.
    fn spawn_primitive(
        &mut self,
        (member, skin): (LodMember, Option<SkinnedMesh>),
        node: &gltf::Node<'_>,
        mesh: &gltf::Mesh<'_>,
        primitive: &gltf::Primitive<'_>,
    ) -> LodPrimitive {
        let label = GltfAssetLabel::Primitive { mesh: mesh.index(), primitive: primitive.index() };
        let handle: Handle<Mesh> = self.context.get_label_handle(label.to_string());
        let material = primitive.material();
        let name = format!("{}.{}", node.name().unwrap_or("LOD"), primitive.index());
        let turn = turn(self.defaults.convert_coordinates);
        let weights = self.morph_weights(mesh, primitive);
        let mut entity = self.world.spawn((
            Mesh3d(handle.clone()),
            Transform::from_rotation(turn),
            aabb(bounds::own(primitive), turn),
            Name::new(name),
            ChildOf(self.root),
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
            Some(index) => GltfAssetLabel::Material { index, is_scale_inverted: false },
            None => GltfAssetLabel::DefaultMaterial,
        };
        let label = label.to_string();
        for other in self.others.iter_mut() {
            other.on_spawn_mesh_and_material(self.context, primitive, mesh, &material, &mut entity, &label);
        }
        LodPrimitive { entity: entity.id(), mesh: handle, faces: file::faces(primitive) }
    }
}

/// The half turn that a loader which turns meshes to Bevy's forward gives their entities in return.
fn turn(convert: GltfConvertCoordinates) -> Quat {
    if convert.rotate_meshes { Quat::from_xyzw(0.0, 1.0, 0.0, 0.0) } else { Quat::IDENTITY }
}

/// The box of a mesh after `turn`, an identity or a half turn about y.
fn aabb(bounds: Bounds, turn: Quat) -> Aabb {
    let (a, b) = (turn * bounds.min, turn * bounds.max);
    Aabb::from_min_max(a.min(b), a.max(b))
}
