//! The levels that objects come with: which of them a bake can place beside its own.

use std::collections::HashMap;

use serde_json::Value;

use super::find::Object;
use super::recipe::{INSTANCING, Recipe};
use crate::gltf::authored::{AuthoredLevels, authored_levels, level_nodes};
use crate::gltf::export::builder::{Builder, Kind, index, indices};
use crate::gltf::export::hierarchy::descendants;
use crate::gltf::triangles;

/// The levels of the file that belong to no object yet, by the mesh nodes that they stand for.
pub(super) struct OwnLevels {
    by_meshes: HashMap<Vec<usize>, AuthoredLevels>,
    /// Number of levels that cannot be placed.
    pub(super) left_out: usize,
}

/// A level that an object comes with: one mesh in the space of the object, or on its skin.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct OwnLevel {
    pub(super) mesh: usize,
    pub(super) faces: u64,
    /// The mesh node of the object whose skin it is on, by its number in the object.
    pub(super) skinned: Option<usize>,
}

impl OwnLevels {
    /// The levels of a scene. `mesh_nodes` are the nodes of its objects.
    pub(super) fn of(out: &Builder, mesh_nodes: &[usize]) -> Self {
        let levels = level_nodes(out.all(Kind::Node));
        let key = |base: usize| {
            let below = descendants(out, &[base]);
            let of_object = |node: &usize| mesh_nodes.binary_search(node).is_ok() && !levels.contains(node);
            let mut meshes: Vec<usize> = below.into_iter().filter(of_object).collect();
            meshes.sort_unstable();
            meshes
        };
        let groups = authored_levels(out.all(Kind::Node));
        let left_out = groups.iter().map(|group| group.levels.len()).sum();
        Self { by_meshes: groups.into_iter().map(|group| (key(group.base), group)).collect(), left_out }
    }

    /// The levels of an object, in falling detail.
    pub(super) fn take(&mut self, out: &Builder, object: &Object) -> Vec<OwnLevel> {
        let Some(group) = self.by_meshes.remove(&object.mesh_nodes) else { return Vec::new() };
        let mut levels: Vec<OwnLevel> =
            group.levels.into_iter().filter_map(|node| OwnLevel::new(out, object, node)).collect();
        levels.sort_by_key(|level| std::cmp::Reverse(level.faces));
        self.left_out -= levels.len();
        levels
    }
}

impl OwnLevel {
    /// `None` for a level of several meshes, or one that is instanced, morphed, or on a skin that the object does not have.
    fn new(out: &Builder, object: &Object, node: usize) -> Option<Self> {
        let nodes = out.all(Kind::Node);
        let source = &nodes[node];
        let is_alone = descendants(out, &[node]).iter().skip(1).all(|&below| nodes[below].get("mesh").is_none());
        let is_plain = is_alone && source.pointer(&format!("/extensions/{INSTANCING}")).is_none();
        let mesh = index(source, "mesh").filter(|_| is_plain)?;
        let primitives = out.all(Kind::Mesh).get(mesh)?.get("primitives")?.as_array()?;
        if primitives.iter().any(|primitive| primitive.get("targets").is_some()) {
            return None;
        }
        let skinned = match index(source, "skin") {
            None => {
                object.anchor?;
                None
            }
            skin => {
                let has_skin = |node: &&usize| index(&nodes[**node], "skin") == skin;
                let node = object.mesh_nodes.iter().find(has_skin)?;
                Some(object.nodes.iter().position(|other| other == node)?)
            }
        };
        let faces = triangles::of_mesh(out, mesh);
        (faces > 0).then_some(Self { mesh, faces, skinned })
    }

    /// The object with this level in place of its meshes, without clips.
    pub(super) fn recipe(&self, object: &Recipe) -> Recipe {
        object.with_mesh(self.skinned.unwrap_or(0), self.mesh)
    }

    /// The skin of the level: its joints by their numbers in the object, and the accessor of the matrices.
    pub(super) fn skin(&self, object: &Recipe) -> Option<(Vec<usize>, Option<usize>)> {
        let skin: &Value = object.skin_of(self.skinned?)?;
        Some((indices(skin, "joints").collect(), index(skin, "inverseBindMatrices")))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn scene() -> Builder {
        let mut out = Builder::new("test");
        let primitive = |accessor: usize| json!({ "attributes": { "POSITION": accessor } });
        let meshes = json!([
            { "primitives": [primitive(0)] }, { "primitives": [primitive(1), primitive(1)] },
            { "primitives": [{ "attributes": { "POSITION": 1 }, "targets": [{}] }] },
        ]);
        out.json.insert("meshes".into(), meshes);
        out.json.insert("accessors".into(), json!([{ "count": 30 }, { "count": 9 }]));
        out
    }

    fn single(node: usize) -> Object {
        Object { holder: node, anchor: Some(node), nodes: vec![node], mesh_nodes: vec![node], owns_subtree: true }
    }

    #[test]
    fn an_object_takes_the_levels_of_its_node() {
        let mut out = scene();
        let nodes = json!([
            { "name": "A_LOD0", "mesh": 0 }, { "name": "A_LOD1", "mesh": 1 }, { "name": "B", "mesh": 0 },
            { "name": "B_LOD1", "mesh": 2 }, { "name": "B_LOD2", "children": [5, 6] }, { "mesh": 1 }, { "mesh": 1 },
        ]);
        out.json.insert("nodes".into(), nodes);
        let mut own = OwnLevels::of(&out, &[0, 2]);
        assert_eq!(own.left_out, 3);
        assert_eq!(own.take(&out, &single(0)), [OwnLevel { mesh: 1, faces: 6, skinned: None }]);
        // One is morphed, one consists of two meshes.
        assert_eq!(own.take(&out, &single(2)), []);
        assert_eq!(own.left_out, 2);
    }

    #[test]
    fn a_level_is_on_the_skin_of_its_object() {
        let mut out = scene();
        let nodes = json!([
            { "name": "A_LOD0", "mesh": 0, "skin": 1 }, { "name": "A_LOD1", "mesh": 1, "skin": 1 },
            { "name": "A_LOD2", "mesh": 1, "skin": 0 }, {},
        ]);
        out.json.insert("nodes".into(), nodes);
        let object = Object { holder: 0, anchor: None, nodes: vec![3, 0], mesh_nodes: vec![0], owns_subtree: false };
        let levels = OwnLevels::of(&out, &[0]).take(&out, &object);
        assert_eq!(levels, [OwnLevel { mesh: 1, faces: 6, skinned: Some(1) }]);
    }
}
