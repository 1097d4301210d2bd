//! The part of a file that is loaded on demand.

use std::collections::BTreeSet;

use bytes::Bytes;
use serde_json::{Value, json};
use simpliguard_texture::ImageExtras;

use super::extras::set_extras;
use super::placeholder::{can_replace_mesh, replace_image, replace_mesh};

use crate::data::Document;
use crate::gltf::export::builder::{Builder, Kind, index, indices};
use crate::gltf::export::prune::each_reference;
use crate::gltf::gpu_cost::{primitive_memory, texture_memory};

/// The meshes and images of the source that only it shows.
pub(super) struct SourcePart {
    pub(super) meshes: BTreeSet<usize>,
    /// The textures that show the images.
    pub(super) textures: BTreeSet<usize>,
    /// Bytes of both on the GPU.
    pub(super) gpu_bytes: u64,
    images: BTreeSet<usize>,
}

impl SourcePart {
    /// The part of a file. `None` if it has none.
    pub(super) fn of(file: &Builder) -> Option<Self> {
        let extras = file.json.get("asset")?.get("extras");
        let replaced = replaced_nodes(file);
        if extras.is_some_and(|extras| !extras.is_object()) || !scenes_are_whole(file, &replaced) {
            return None;
        }
        let nodes = || file.all(Kind::Node).iter().enumerate();
        let mesh_of = |node: &Value| index(node, "mesh");
        let shown_elsewhere: BTreeSet<usize> =
            nodes().filter(|(i, _)| !replaced.contains(i)).filter_map(|(_, node)| mesh_of(node)).collect();
        let meshes = nodes().filter(|(i, _)| replaced.contains(i)).filter_map(|(_, node)| mesh_of(node));
        let is_own = |mesh: &usize| !shown_elsewhere.contains(mesh) && can_replace_mesh(file, *mesh);
        let meshes: BTreeSet<usize> = meshes.filter(is_own).collect();
        if meshes.is_empty() {
            return None;
        }
        let document = document(file);
        let images = images_of(file, &meshes);
        let is_own = |texture: &Value| index(texture, "source").is_some_and(|image| images.contains(&image));
        let textures = file.all(Kind::Texture).iter().enumerate().filter(|(_, texture)| is_own(texture));
        let textures: BTreeSet<usize> = textures.map(|(i, _)| i).collect();
        let primitives = meshes.iter().flat_map(|&mesh| file.all(Kind::Mesh)[mesh]["primitives"].as_array());
        let of_meshes = primitives.flatten().filter_map(|primitive| primitive_memory(&document, primitive));
        let of_textures = textures.iter().filter_map(|&texture| texture_memory(&document, texture));
        let gpu_bytes = of_meshes.sum::<u64>() + of_textures.sum::<u64>();
        Some(Self { meshes, textures, gpu_bytes, images })
    }

    /// Puts placeholders in place of the source.
    pub(super) fn remove_source(&self, file: &mut Builder) {
        self.meshes.iter().for_each(|&mesh| replace_mesh(file, mesh));
        self.images.iter().for_each(|&image| replace_image(file, image));
    }

    /// Puts placeholders in place of all else, and removes scenes and clips.
    pub(super) fn remove_levels(&self, file: &mut Builder) {
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
        set_extras(file, json!({ "part": "source" }));
    }
}

/// The nodes that levels stand for, but for levels that stand for all objects: these have levels of their own.
fn replaced_nodes(file: &Builder) -> BTreeSet<usize> {
    let stamps = file.all(Kind::Node).iter().filter_map(|node| node.pointer("/extras/simpliguard"));
    let own = stamps.filter(|stamp| stamp.get("level").is_some() && stamp.get("whole") != Some(&json!(true)));
    own.flat_map(|stamp| indices(stamp, "replaces")).collect()
}

/// True if each scene has all of these nodes or none.
fn scenes_are_whole(file: &Builder, nodes: &BTreeSet<usize>) -> bool {
    file.all(Kind::Scene).iter().all(|scene| {
        let (mut open, mut seen) = (indices(scene, "nodes").collect::<Vec<_>>(), BTreeSet::new());
        while let Some(node) = open.pop() {
            if seen.insert(node) {
                open.extend(file.all(Kind::Node).get(node).into_iter().flat_map(|node| indices(node, "children")));
            }
        }
        let count = nodes.iter().filter(|node| seen.contains(node)).count();
        count == 0 || count == nodes.len()
    })
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
