//! The levels in an output of `bake`, by what their nodes say in `extras.simpliguard`.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import, with_json};
use simpliguard::{Error, NoResources, Source, StageId};

/// A level in an output of `bake`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LevelNode {
    /// Its number, from 1, the smallest.
    pub(crate) level: u64,
    pub(crate) budget: Option<u64>,
    pub(crate) faces: Option<u64>,
    /// Distance that 95 % of both surfaces stay within, as a fraction of the diagonal of the source's bounding box.
    pub(crate) error: Option<f64>,
    /// Its mesh.
    pub(crate) mesh: Option<usize>,
    /// The index of the node itself.
    pub(crate) node: usize,
}

/// The levels of a document as a whole, the smallest first. None if it is no output of `bake`, or one with levels for each
/// object.
pub(crate) fn levels_of(json: &Value) -> Vec<LevelNode> {
    let level = |(index, node): (usize, &Value)| {
        let own = node.get("extras")?.get("simpliguard").filter(|own| own.get("object").is_none())?;
        let number = own.get("level")?.as_u64()?;
        Some(LevelNode {
            level: number,
            budget: own.get("budget").and_then(Value::as_u64),
            faces: own.get("faces").and_then(Value::as_u64),
            error: own.get("error").and_then(Value::as_f64),
            mesh: node.get("mesh").and_then(Value::as_u64).map(|mesh| mesh as usize),
            node: index,
        })
    };
    let nodes = json.get("nodes").and_then(Value::as_array).into_iter().flatten();
    let mut levels: Vec<LevelNode> = nodes.enumerate().filter_map(level).collect();
    levels.sort_by_key(|level| level.level);
    levels
}

impl LevelNode {
    /// Reads the level alone from the file that holds it, on the joints of the source, which its clips move.
    ///
    /// # Errors
    /// Those of the import, and if the file is no binary glTF.
    pub(crate) fn model(&self, name: &str, json: &Value, file: &[u8]) -> Result<Model, Error> {
        let own = format!("{name}, LOD{}", self.level);
        let bytes = self.alone(json).and_then(|json| with_json(file, &json)).ok_or_else(|| {
            let found = "it is no binary glTF with a scene, as every output of this program is";
            Error::invalid(&own, StageId::Import, found, "bake the model again")
        })?;
        import(&Source { name: &own, bytes: &bytes, resources: &NoResources }, &ImportLimits::default())
    }

    /// The document with this level as the only mesh of its default scene.
    fn alone(&self, json: &Value) -> Option<Value> {
        let mut json = json.clone();
        for (i, node) in json.get_mut("nodes")?.as_array_mut()?.iter_mut().enumerate() {
            if i != self.node {
                node.as_object_mut()?.remove("mesh");
                node.as_object_mut()?.remove("skin");
            }
        }
        let scene = json.get("scene").and_then(Value::as_u64).unwrap_or(0) as usize;
        let mut roots = indices(json.get("scenes")?.get(scene)?, "nodes");
        if !is_below(&json, &roots, self.node) {
            roots.push(self.node);
        }
        *json.get_mut("scenes")?.get_mut(scene)? = json!({ "nodes": roots });
        Some(json)
    }
}

/// A list of indices; empty if there is none.
pub(crate) fn indices(object: &Value, name: &str) -> Vec<usize> {
    let list = object.get(name).and_then(Value::as_array).into_iter().flatten();
    list.filter_map(|index| usize::try_from(index.as_u64()?).ok()).collect()
}

/// Tells whether a node is one of `roots` or below one.
fn is_below(json: &Value, roots: &[usize], node: usize) -> bool {
    let (mut seen, mut left) = (BTreeSet::new(), roots.to_vec());
    while let Some(next) = left.pop() {
        if seen.insert(next) {
            left.extend(
                json.get("nodes").and_then(|nodes| nodes.get(next)).map(|n| indices(n, "children")).unwrap_or_default(),
            );
        }
    }
    seen.contains(&node)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn levels_are_found_by_their_nodes_and_stand_alone() {
        let document = json!({
            "scenes": [{"nodes": [3]}],
            "nodes": [
                {"mesh": 0, "extras": {"simpliguard": "other"}},
                {"mesh": 7, "skin": 1, "extras": {"simpliguard": {"level": 2, "budget": 20, "faces": 19, "error": 0.5}}},
                {"extras": {"simpliguard": {"level": 1}}},
                {"mesh": 5, "skin": 0, "children": [0, 2]},
            ],
        });
        let levels = levels_of(&document);
        let found: Vec<_> = levels.iter().map(|l| (l.level, l.node, l.mesh)).collect();
        assert_eq!(found, [(1, 2, None), (2, 1, Some(7))]);
        assert_eq!((levels[1].budget, levels[1].faces, levels[1].error), (Some(20), Some(19), Some(0.5)));
        assert!(levels_of(&json!({})).is_empty());
        let alone = levels[1].alone(&document).expect("a scene");
        assert_eq!(alone["scenes"][0]["nodes"], json!([3, 1]));
        assert_eq!(alone["nodes"][3], json!({"children": [0, 2]}));
        assert_eq!((&alone["nodes"][1], alone["nodes"][0].get("mesh")), (&document["nodes"][1], None));
        // One that stands in the scene is not added again.
        assert_eq!(levels[0].alone(&document).expect("a scene")["scenes"][0]["nodes"], json!([3]));
    }
}
