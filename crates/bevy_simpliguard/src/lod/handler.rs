//! Builds the LOD group of a scene while Bevy's glTF loader builds the scene.
//!
//! Level nodes are in no scene, so the loader creates their meshes and materials but no entities. The handler spawns
//! them under the root of the scene, as the loader would do, and inserts [`LodGroup`] into that root.
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
use super::mipmaps::{self, Mipmaps};

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
    /// Makes mipmaps for textures. `None` if they are switched off.
    mipmaps: Option<Mipmaps>,
    /// The levels of the file that is being loaded, if it has any.
    file: Option<Arc<LodFile>>,
    /// Box of the most detailed level in scene space.
    bounds: Option<Bounds>,
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
        let mipmaps = self.mipmaps.as_mut().filter(|_| self.file.is_some());
        let images = mipmaps.map(|mipmaps| mipmaps.start(&primitive.material(), buffers));
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
        // Levels stand for all nodes that they were made from. A scene with only some of these nodes, or the scene of a
        // single level, gets no group.
        if !std::iter::once(&file.holder).chain(&file.replaces).all(|node| entities.contains_key(node)) {
            return;
        }
        let defaults = self.defaults;
        let builder = SceneBuilder { context, world, root, file: &file, entities, others: &mut self.others, defaults };
        builder.build(bounds);
    }
}

/// A scene that levels are added to.
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

    /// The source: the entities that the loader has spawned for the nodes in `replaces`. `None` if they have no meshes,
    /// because the file was baked without the source.
    fn source(&mut self) -> Option<LodLevel> {
        let (mut primitives, mut textures) = (Vec::new(), Vec::new());
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
            textures.extend(mesh.iter().flat_map(|mesh| embedded_textures(mesh)));
        }
        let faces = primitives.iter().map(|p| p.faces).sum();
        let is_there = !primitives.is_empty();
        let textures = self.handles(textures);
        is_there.then_some(LodLevel { level: 0, budget: faces, faces, error: 0.0, primitives, textures })
    }

    /// Spawns a level. `None`, with a warning, if its joints are not in this scene.
    fn spawn_level(&mut self, level: &FileLevel) -> Option<LodLevel> {
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
        let member = LodMember { group: self.root, level: level.level };
        let spawn = |p: gltf::Primitive<'_>| self.spawn_primitive((member.clone(), skin.clone()), &node, &mesh, &p);
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

    /// Spawns a primitive of a level under the root of the scene, with all components that the loader would insert.
    /// Inserts [`LodMember`] before other handlers are called, so that they can tell the level from the source.
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
        let rotation = mesh_rotation(self.defaults.convert_coordinates);
        let weights = self.morph_weights(mesh, primitive);
        let mut entity = self.world.spawn((
            Mesh3d(handle.clone()),
            Transform::from_rotation(rotation),
            aabb(bounds::own(primitive), rotation),
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
