//! The levels of an object: taken out of its baked file, and written as nodes for each of its instances.

use std::collections::HashMap;

use serde::Deserialize;
use serde_json::{Value, json};

use super::copy::Copier;
use super::find::Object;
use super::own_levels::OwnLevel;
use super::recipe::{INSTANCING, Recipe};
use super::shared_atlas::SharedAtlas;
use crate::Error;
use crate::gltf::export::builder::{Builder, Kind, index, indices};
use crate::gltf::export::clips::copy_weight_channels;
use crate::gltf::export::hierarchy::TRANSFORM;
use crate::gltf::export::lods::{screen_coverages, set_lods};

/// The levels of all instances of an object.
#[derive(Clone, Default)]
pub(super) struct Levels {
    /// In falling detail.
    levels: Vec<Level>,
}

/// A level whose mesh is in the scene's document.
#[derive(Clone)]
struct Level {
    mesh: usize,
    skin: Option<Skin>,
    stamp: Stamp,
}

/// What the export has written to a level's node.
#[derive(Clone, Deserialize)]
struct Stamp {
    level: u32,
    budget: u32,
    faces: u32,
    error: Value,
    /// The node of the object whose morph targets the level has.
    morphs: Option<usize>,
    /// For each primitive, the material that it has kept: in a file, that of the object; here, that of the scene. Empty if
    /// all are baked.
    #[serde(default)]
    materials: Vec<Option<usize>>,
}

/// The skin of a level.
#[derive(Clone)]
struct Skin {
    /// Joints by their numbers in the object.
    joints: Vec<usize>,
    /// The accessor of the matrices in the scene.
    inverse_bind: Option<usize>,
}

impl Levels {
    /// Copies the levels in the file of a baked object into the scene. The smallest leaves its textures to `atlas`. Materials that
    /// levels have kept are the scene's own: `materials` has the scene's for each of the object's.
    ///
    /// # Errors
    /// If the file is none that the export writes.
    pub(super) fn take(
        scene: &mut Builder,
        name: &str,
        glb: &[u8],
        materials: &HashMap<usize, usize>,
        mut atlas: Option<&mut SharedAtlas>,
    ) -> Result<Self, Error> {
        let (mut from, mut copier) = (Builder::from_glb(&scene.asset, glb)?, Copier::new(false));
        let level = |(i, node): (usize, &Value)| {
            let stamp = Stamp::deserialize(node.pointer("/extras/simpliguard")?).ok()?;
            Some((i, stamp, index(node, "mesh")?))
        };
        let found: Vec<(usize, Stamp, usize)> = from.all(Kind::Node).iter().enumerate().filter_map(level).collect();
        for (_, stamp, mesh) in &found {
            copier.know_materials(kept_materials(&from, *mesh, &stamp.materials, materials));
        }
        let smallest = found.iter().min_by_key(|(_, stamp, _)| stamp.budget).map(|(_, _, mesh)| *mesh);
        let mut taken = smallest.and_then(|mesh| Some(atlas.as_mut()?.take_materials(&mut from, mesh)));
        let mut levels = Vec::new();
        for (node, mut stamp, file_mesh) in found {
            stamp.materials.iter_mut().flatten().for_each(|kept| *kept = materials.get(kept).copied().unwrap_or(*kept));
            let node = &from.all(Kind::Node)[node];
            let Some(mesh) = copier.copy(&from, scene, Kind::Mesh, file_mesh) else { continue };
            if let Some((atlas, taken)) = atlas.as_mut().zip(taken.take_if(|_| Some(file_mesh) == smallest)) {
                stamp.materials.clear();
                atlas.add(mesh, taken);
            }
            scene.all_mut(Kind::Mesh)[mesh]["name"] = json!(format!("{name} LOD{}", stamp.level));
            let skin = index(node, "skin").and_then(|skin| from.all(Kind::Skin).get(skin)).map(|skin| {
                let matrices = index(skin, "inverseBindMatrices");
                let inverse_bind = matrices.and_then(|accessor| copier.copy(&from, scene, Kind::Accessor, accessor));
                Skin { joints: indices(skin, "joints").collect(), inverse_bind }
            });
            levels.push(Level { mesh, skin, stamp });
        }
        levels.sort_by_key(|level| std::cmp::Reverse(level.stamp.budget));
        Ok(Self { levels })
    }

    /// Adds levels that the object came with, behind those that were baked. A baked one that is not smaller than each of them
    /// goes.
    pub(super) fn add_own(&mut self, object: &Recipe, own: &[(OwnLevel, f32)]) {
        let fewest = own.iter().map(|(level, _)| level.faces).min().unwrap_or(u64::MAX);
        self.levels.retain(|level| u64::from(level.stamp.faces) < fewest);
        let baked = self.levels.len();
        let number = |above: usize| (baked + own.len() - above) as u32;
        let level = |(above, (level, error)): (usize, &(OwnLevel, f32))| {
            let faces = u32::try_from(level.faces).unwrap_or(u32::MAX);
            let skin = level.skin(object).map(|(joints, inverse_bind)| Skin { joints, inverse_bind });
            let stamp = Stamp {
                level: number(above),
                budget: faces,
                faces,
                error: json!(error),
                morphs: None,
                materials: Vec::new(),
            };
            Level { mesh: level.mesh, skin, stamp }
        };
        let own: Vec<Level> = own.iter().enumerate().map(level).collect();
        self.levels.splice(0..0, own);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.levels.is_empty()
    }

    /// Writes the nodes of an instance of the object. Returns the first: the most detailed level.
    pub(super) fn place(&self, scene: &mut Builder, object: &Object, version: &str) -> Option<usize> {
        let first = scene.all(Kind::Node).len();
        for level in &self.levels {
            let node = level.node(scene, object, version);
            let node = scene.push(Kind::Node, node);
            if let Some(driver) = level.stamp.morphs.and_then(|driver| object.nodes.get(driver)) {
                copy_weight_channels(scene, *driver, &[node]);
            }
        }
        let ids: Vec<usize> = (first..scene.all(Kind::Node).len()).collect();
        if let Some(anchor) = object.anchor.filter(|_| object.owns_subtree && !ids.is_empty()) {
            let errors = self.levels.iter().map(|level| level.stamp.error.as_f64().unwrap_or(0.0));
            set_lods(scene, anchor, &ids, &screen_coverages(errors));
        }
        ids.first().copied()
    }

    /// Writes the nodes of levels that stand for all objects. Nodes have the same numbers in the scene and in the file that
    /// the levels come from.
    pub(super) fn place_whole(&self, scene: &mut Builder, mesh_nodes: &[usize], version: &str) {
        let nodes = (0..scene.all(Kind::Node).len()).collect();
        let Some(&holder) = mesh_nodes.first() else { return };
        let whole = Object { holder, anchor: None, nodes, mesh_nodes: mesh_nodes.to_vec(), owns_subtree: false };
        for level in &self.levels {
            let mut node = level.node(scene, &whole, version);
            node["name"] = json!(format!("Whole LOD{}", level.stamp.level));
            if let Some(stamp) = node.pointer_mut("/extras/simpliguard").and_then(Value::as_object_mut) {
                stamp.remove("object");
                stamp.insert("whole".into(), json!(true));
            }
            let node = scene.push(Kind::Node, node);
            if let Some(driver) = level.stamp.morphs {
                copy_weight_channels(scene, driver, &[node]);
            }
        }
    }
}

/// The materials in the file of an object that a level has kept, with their places in the scene.
fn kept_materials(
    from: &Builder,
    mesh: usize,
    kept: &[Option<usize>],
    of_scene: &HashMap<usize, usize>,
) -> Vec<(usize, usize)> {
    let primitives = from.all(Kind::Mesh).get(mesh).and_then(|mesh| mesh.get("primitives")?.as_array());
    let materials = primitives.into_iter().flatten().map(|primitive| index(primitive, "material"));
    materials.zip(kept).filter_map(|(material, kept)| Some((material?, *of_scene.get(&(*kept)?)?))).collect()
}

impl Level {
    fn node(&self, scene: &mut Builder, object: &Object, version: &str) -> Value {
        let Stamp { level, budget, faces, error, morphs, materials } = &self.stamp;
        let holder = &scene.all(Kind::Node)[object.holder];
        let name = holder.get("name").and_then(Value::as_str).map_or_else(String::new, |name| format!("{name} "));
        let mut stamp = json!({
            "version": version, "level": level, "budget": budget, "faces": faces, "error": error,
            "object": object.holder, "replaces": object.mesh_nodes,
        });
        if let Some(anchor) = object.anchor {
            stamp["space"] = json!(anchor);
        }
        if let Some(driver) = morphs.and_then(|driver| object.nodes.get(driver)) {
            stamp["morphs"] = json!(driver);
        }
        if !materials.is_empty() {
            stamp["materials"] = json!(materials);
        }
        let mut node = json!({ "name": format!("{name}LOD{level}"), "mesh": self.mesh });
        if let Some(anchor) = object.anchor.map(|anchor| &scene.all(Kind::Node)[anchor]) {
            if self.skin.is_none() {
                TRANSFORM.iter().filter_map(|&key| Some((key, anchor.get(key)?))).for_each(|(key, value)| {
                    node[key] = value.clone();
                });
            }
            let instancing = anchor.get("extensions").and_then(|extensions| extensions.get(INSTANCING));
            if let Some(instancing) = instancing.filter(|_| object.nodes.len() == 1) {
                node["extensions"] = json!({ INSTANCING: instancing });
            }
        }
        node["extras"] = json!({ "simpliguard": stamp });
        if let Some(skin) = &self.skin {
            node["skin"] = json!(skin.write(scene, object));
        }
        node
    }
}

impl Skin {
    /// Writes the skin on the joints of an instance.
    fn write(&self, scene: &mut Builder, object: &Object) -> usize {
        let joints: Vec<usize> = self.joints.iter().filter_map(|&joint| object.nodes.get(joint).copied()).collect();
        let mut skin = json!({ "joints": joints });
        if let Some(accessor) = self.inverse_bind {
            skin["inverseBindMatrices"] = json!(accessor);
        }
        scene.push(Kind::Skin, skin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(errors: &[f64]) -> Levels {
        let stamp = |error: f64| {
            let error = json!(error);
            Stamp { level: 1, budget: 9, faces: 8, error, morphs: None, materials: Vec::new() }
        };
        let level = |error: &f64| Level { mesh: 0, skin: None, stamp: stamp(*error) };
        Levels { levels: errors.iter().map(level).collect() }
    }

    #[test]
    fn a_level_is_a_sibling_of_its_object() {
        let mut scene = Builder::new("test");
        let instancing = json!({ INSTANCING: { "attributes": {} } });
        let chair = json!({ "name": "Chair", "mesh": 0, "translation": [1, 2, 3], "extras": { "cost": 5 },
            "extensions": instancing });
        scene.push(Kind::Node, chair);
        let object = Object { holder: 0, anchor: Some(0), nodes: vec![0], mesh_nodes: vec![0], owns_subtree: true };
        assert_eq!(levels(&[0.01]).place(&mut scene, &object, "7"), Some(1));
        let stamp = json!({ "version": "7", "level": 1, "budget": 9, "faces": 8, "error": 0.01, "object": 0,
            "replaces": [0], "space": 0 });
        let level = json!({ "name": "Chair LOD1", "mesh": 0, "translation": [1, 2, 3], "extensions": instancing,
            "extras": { "simpliguard": stamp } });
        assert_eq!(scene.all(Kind::Node)[1], level);
        let chair = &scene.all(Kind::Node)[0];
        assert_eq!(chair["extensions"]["MSFT_lod"]["ids"], json!([1]));
        assert_eq!(chair["extras"], json!({ "cost": 5, "MSFT_screencoverage": [0.00379, 0.0] }));
    }

    #[test]
    fn materials_that_a_level_has_kept_are_those_of_the_scene() {
        let mut baked = Builder::new("chair");
        for name in ["of the source", "of a level"] {
            baked.push(Kind::Material, json!({ "name": name }));
        }
        let meshes = [0, 0, 1].map(|material| json!({ "primitives": [{ "attributes": {}, "material": material }] }));
        for (i, mesh) in meshes.into_iter().enumerate() {
            let mesh = baked.push(Kind::Mesh, mesh);
            let mut stamp = json!({ "simpliguard": { "level": i, "budget": 10 * i, "faces": 1, "error": 0.0 } });
            if i == 1 {
                stamp["simpliguard"]["materials"] = json!([7]);
            }
            let extras = if i == 0 { json!({}) } else { stamp };
            baked.push(Kind::Node, json!({ "mesh": mesh, "extras": extras }));
        }
        let mut scene = Builder::new("room");
        for name in ["another", "of the source"] {
            scene.push(Kind::Material, json!({ "name": name }));
        }
        let glb = baked.into_glb().expect("small");
        let levels = Levels::take(&mut scene, "Chair", &glb, &HashMap::from([(7, 1)]), None).expect("an export");
        let material = |level: &Level| scene.all(Kind::Mesh)[level.mesh]["primitives"][0]["material"].clone();
        // The most detailed first.
        assert_eq!(levels.levels.iter().map(material).collect::<Vec<_>>(), [2, 1]);
        assert_eq!((scene.all(Kind::Material).len(), &scene.all(Kind::Material)[2]["name"]), (3, &json!("of a level")));
    }

    #[test]
    fn a_level_of_the_whole_belongs_to_no_object() {
        let mut scene = Builder::new("test");
        scene.push(Kind::Node, json!({ "mesh": 0, "translation": [1, 2, 3] }));
        scene.push(Kind::Node, json!({ "mesh": 1 }));
        levels(&[0.01]).place_whole(&mut scene, &[0, 1], "7");
        let stamp = json!({ "version": "7", "level": 1, "budget": 9, "faces": 8, "error": 0.01, "replaces": [0, 1],
            "whole": true });
        assert_eq!(scene.all(Kind::Node).len(), 3);
        let level = json!({ "name": "Whole LOD1", "mesh": 0, "extras": { "simpliguard": stamp } });
        assert_eq!(scene.all(Kind::Node)[2], level);
    }

    #[test]
    fn other_things_below_a_node_are_not_replaced() {
        let mut scene = Builder::new("test");
        scene.push(Kind::Node, json!({ "mesh": 0, "children": [1] }));
        scene.push(Kind::Node, json!({ "camera": 0 }));
        let object = Object { holder: 0, anchor: Some(0), nodes: vec![0], mesh_nodes: vec![0], owns_subtree: false };
        assert_eq!(levels(&[0.01]).place(&mut scene, &object, "7"), Some(2));
        assert!(scene.all(Kind::Node)[0].get("extensions").is_none());
    }
}
