//! The parts of a file that are loaded on demand.

use std::collections::{BTreeMap, BTreeSet};

use bytes::Bytes;
use serde_json::{Value, json};
use simpliguard_texture::ImageExtras;

use super::extras::set_extras;
use super::placeholder::{can_replace_mesh, replace_image, replace_mesh};

use crate::data::Document;
use crate::gltf::export::builder::{Builder, Kind, index, indices};
use crate::gltf::export::hierarchy::{descendants, scene_roots};
use crate::gltf::export::prune::each_reference;
use crate::gltf::gpu_cost::{primitive_memory, texture_memory};
use crate::gltf::triangles;

/// The source or a level: the meshes and images that only it shows.
pub(super) struct Part {
    /// 0 for the source.
    level: u64,
    meshes: BTreeSet<usize>,
    /// Triangles of each primitive of each mesh.
    faces: Vec<Vec<u64>>,
    /// The textures that show the images.
    textures: BTreeSet<usize>,
    images: BTreeSet<usize>,
    /// Bytes of all on the GPU.
    gpu_bytes: u64,
}

impl Part {
    /// The parts of a file: the source, and the levels but for the smallest of each object. Empty if the source is none.
    pub(super) fn all(file: &Builder) -> Vec<Self> {
        let extras = file.json.get("asset").and_then(|asset| asset.get("extras"));
        let replaced = replaced_nodes(file);
        if extras.is_some_and(|extras| !extras.is_object()) || !scenes_are_whole(file, &replaced) {
            return Vec::new();
        }
        let document = document(file);
        let Some(source) = Self::of(file, &document, 0, &replaced) else { return Vec::new() };
        let levels = detailed_levels(file, &replaced);
        let levels = levels.iter().filter_map(|(level, nodes)| Self::of(file, &document, *level, nodes));
        std::iter::once(source).chain(levels).collect()
    }

    /// The part that these nodes show. `None` if others show all of it too.
    fn of(file: &Builder, document: &Document, level: u64, shown_by: &BTreeSet<usize>) -> Option<Self> {
        let nodes = || file.all(Kind::Node).iter().enumerate();
        let mesh_of = |node: &Value| index(node, "mesh");
        let shown_elsewhere: BTreeSet<usize> =
            nodes().filter(|(i, _)| !shown_by.contains(i)).filter_map(|(_, node)| mesh_of(node)).collect();
        let meshes = nodes().filter(|(i, _)| shown_by.contains(i)).filter_map(|(_, node)| mesh_of(node));
        let is_own = |mesh: &usize| !shown_elsewhere.contains(mesh) && can_replace_mesh(file, *mesh);
        let meshes: BTreeSet<usize> = meshes.filter(is_own).collect();
        if meshes.is_empty() {
            return None;
        }
        let images = images_of(file, &meshes);
        let is_own = |texture: &Value| index(texture, "source").is_some_and(|image| images.contains(&image));
        let textures = file.all(Kind::Texture).iter().enumerate().filter(|(_, texture)| is_own(texture));
        let textures: BTreeSet<usize> = textures.map(|(i, _)| i).collect();
        let primitives = meshes.iter().flat_map(|&mesh| file.all(Kind::Mesh)[mesh]["primitives"].as_array());
        let of_meshes = primitives.flatten().filter_map(|primitive| primitive_memory(document, primitive));
        let of_textures = textures.iter().filter_map(|&texture| texture_memory(document, texture));
        let gpu_bytes = of_meshes.sum::<u64>() + of_textures.sum::<u64>();
        let faces = meshes.iter().map(|&mesh| triangles::of_primitives(file, mesh).collect()).collect();
        Some(Self { level, meshes, faces, textures, images, gpu_bytes })
    }

    /// The name of its file, in a version of the model.
    pub(super) fn file_name(&self, version: &str) -> String {
        match self.level {
            0 => format!("{version}.glb"),
            level => format!("{version}_LOD{level}.glb"),
        }
    }

    /// Its description in the file with the smallest levels.
    pub(super) fn stamp(&self, file: &str) -> Value {
        let Self { level, meshes, faces, textures, gpu_bytes, .. } = self;
        json!({
            "level": level, "file": file, "bytes": gpu_bytes, "meshes": meshes, "faces": faces, "textures": textures,
        })
    }

    /// Puts placeholders in its place.
    pub(super) fn remove(&self, file: &mut Builder) {
        self.meshes.iter().for_each(|&mesh| replace_mesh(file, mesh));
        self.images.iter().for_each(|&image| replace_image(file, image));
    }

    /// Puts placeholders in place of all else, and removes scenes and clips.
    pub(super) fn remove_rest(&self, file: &mut Builder) {
        for mesh in (0..file.all(Kind::Mesh).len()).filter(|mesh| !self.meshes.contains(mesh)) {
            replace_mesh(file, mesh);
        }
        let is_other =
            |&image: &usize| !self.images.contains(&image) && file.all(Kind::Image)[image].get("bufferView").is_some();
        let others: Vec<usize> = (0..file.all(Kind::Image).len()).filter(is_other).collect();
        others.into_iter().for_each(|image| replace_image(file, image));
        for key in ["scene", "scenes", "animations"] {
            file.json.remove(key);
        }
        for node in file.all_mut(Kind::Node).iter_mut().filter_map(Value::as_object_mut) {
            node.remove("extras");
            node.remove("extensions");
        }
        set_extras(file, json!({ "part": if self.level == 0 { "source" } else { "level" } }));
    }
}

/// The stamps of the nodes of levels, but for those that stand for all objects: these have levels of their own.
fn stamps(file: &Builder) -> impl Iterator<Item = (usize, &Value)> {
    let nodes = file.all(Kind::Node).iter().enumerate();
    let stamps = nodes.filter_map(|(i, node)| Some((i, node.pointer("/extras/simpliguard")?)));
    stamps.filter(|(_, stamp)| stamp.get("level").is_some() && stamp.get("whole") != Some(&json!(true)))
}

/// The nodes that levels stand for.
fn replaced_nodes(file: &Builder) -> BTreeSet<usize> {
    stamps(file).flat_map(|(_, stamp)| indices(stamp, "replaces")).collect()
}

/// The nodes that show each level, in the scene of the source or alone, without the smallest level of each object.
fn detailed_levels(file: &Builder, source: &BTreeSet<usize>) -> BTreeMap<u64, BTreeSet<usize>> {
    let number = |stamp: &Value| stamp.get("level").and_then(Value::as_u64);
    let mut smallest: BTreeMap<Option<usize>, u64> = BTreeMap::new();
    for (_, stamp) in stamps(file) {
        let level = number(stamp).unwrap_or(0);
        smallest.entry(index(stamp, "object")).and_modify(|least| *least = level.min(*least)).or_insert(level);
    }
    let mut levels: BTreeMap<u64, BTreeSet<usize>> = BTreeMap::new();
    for (node, stamp) in stamps(file) {
        let is_detailed = |level: &u64| smallest.get(&index(stamp, "object")).is_some_and(|least| level > least);
        if let Some(level) = number(stamp).filter(is_detailed) {
            levels.entry(level).or_default().insert(node);
        }
    }
    let alone = shown_alone(file, source);
    for nodes in levels.values_mut() {
        let meshes: BTreeSet<usize> = nodes.iter().filter_map(|node| mesh_of(file, *node)).collect();
        nodes.extend(alone.iter().filter(|node| mesh_of(file, **node).is_some_and(|mesh| meshes.contains(&mesh))));
    }
    levels
}

/// The nodes that no scene with the source shows, but for the levels themselves: copies of levels, in scenes of their own.
fn shown_alone(file: &Builder, source: &BTreeSet<usize>) -> BTreeSet<usize> {
    let with_source: BTreeSet<usize> = scenes(file).filter(|nodes| !nodes.is_disjoint(source)).flatten().collect();
    let is_level = |node: &Value| node.pointer("/extras/simpliguard").is_some();
    let others = file.all(Kind::Node).iter().enumerate().filter(|(_, node)| !is_level(node));
    others.map(|(i, _)| i).filter(|i| !with_source.contains(i)).collect()
}

fn mesh_of(file: &Builder, node: usize) -> Option<usize> {
    index(file.all(Kind::Node).get(node)?, "mesh")
}

/// The nodes of each scene.
fn scenes(file: &Builder) -> impl Iterator<Item = BTreeSet<usize>> {
    let nodes_of = |scene| descendants(file, &scene_roots(file, scene)).into_iter().collect();
    (0..file.all(Kind::Scene).len()).map(nodes_of)
}

/// True if each scene has all of these nodes or none.
fn scenes_are_whole(file: &Builder, nodes: &BTreeSet<usize>) -> bool {
    scenes(file).all(|seen| nodes.is_subset(&seen) || nodes.is_disjoint(&seen))
}

/// The images in the file that only materials of these meshes show.
fn images_of(file: &Builder, meshes: &BTreeSet<usize>) -> BTreeSet<usize> {
    let of_meshes = |own: bool| {
        let chosen = (0..file.all(Kind::Mesh).len()).filter(|mesh| meshes.contains(mesh) == own);
        chosen.flat_map(|mesh| references(file, Kind::Mesh, mesh, Kind::Material)).collect::<BTreeSet<usize>>()
    };
    let own = only(&of_meshes(true), &of_meshes(false));
    let textures = shown(file, &own, (Kind::Material, Kind::Texture));
    let images = shown(file, &textures, (Kind::Texture, Kind::Image));
    let is_plain = |image: &usize| file.all(Kind::Image)[*image].get("bufferView").is_some();
    images.into_iter().filter(|image| *image < file.all(Kind::Image).len()).filter(is_plain).collect()
}

/// The objects that `own` ones of a kind refer to, and no others of the kind.
fn shown(file: &Builder, own: &BTreeSet<usize>, (kind, target): (Kind, Kind)) -> BTreeSet<usize> {
    let of = |is_own: bool| {
        let chosen = (0..file.all(kind).len()).filter(|i| own.contains(i) == is_own);
        chosen.flat_map(|i| references(file, kind, i, target)).collect::<BTreeSet<usize>>()
    };
    only(&of(true), &of(false))
}

fn only(own: &BTreeSet<usize>, others: &BTreeSet<usize>) -> BTreeSet<usize> {
    own.difference(others).copied().collect()
}

fn references(file: &Builder, kind: Kind, i: usize, target: Kind) -> Vec<usize> {
    let (mut object, mut found) = (file.all(kind)[i].clone(), Vec::new());
    each_reference(kind, &mut object, &mut |kind, reference| {
        found.extend(reference.as_u64().filter(|_| kind == target).map(|i| i as usize));
    });
    found
}

/// The file as a document, with the sizes of its images in blocks.
fn document(file: &Builder) -> Document {
    let images = file.all(Kind::Image).iter().enumerate();
    let bytes_of = |image: &Value| {
        let extras = serde_json::from_value::<ImageExtras>(image.get("extras")?.clone()).ok()?;
        Some(extras.simpliguard.bc7.gpu_bytes())
    };
    let block_bytes = images.filter_map(|(i, image)| Some((i, bytes_of(image)?))).collect();
    let json = Value::Object(file.json.clone());
    Document { json, buffers: vec![Bytes::copy_from_slice(&file.bin)], block_bytes, ..Document::default() }
}
