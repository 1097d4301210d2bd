//! The levels in an output of `bake`, by what their nodes say in `extras.simpliguard`.

use serde_json::Value;
use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::{Error, NoResources, Source, StageId};

/// Bytes of the header of a binary glTF, and of that of a chunk.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
/// Kind of the chunk with the JSON.
const JSON_CHUNK: &[u8] = b"JSON";

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
    /// The scene that loads it alone.
    scene: Option<usize>,
}

/// The levels of a document, the smallest first. None if it is no output of `bake`.
pub(crate) fn levels_of(json: &Value) -> Vec<LevelNode> {
    let list = |name: &str| json.get(name).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let level = |node: &Value| {
        let own = node.get("extras")?.get("simpliguard")?;
        let number = own.get("level")?.as_u64()?;
        let name = format!("LOD{number}");
        let is_own = |scene: &Value| scene.get("name").and_then(Value::as_str) == Some(name.as_str());
        Some(LevelNode {
            level: number,
            budget: own.get("budget").and_then(Value::as_u64),
            faces: own.get("faces").and_then(Value::as_u64),
            error: own.get("error").and_then(Value::as_f64),
            mesh: node.get("mesh").and_then(Value::as_u64).map(|mesh| mesh as usize),
            // Scenes of levels follow those of the source, which may have the same name.
            scene: list("scenes").iter().rposition(is_own),
        })
    };
    let mut levels: Vec<LevelNode> = list("nodes").iter().filter_map(level).collect();
    levels.sort_by_key(|level| level.level);
    levels
}

impl LevelNode {
    /// Reads the level alone from the file that holds it.
    ///
    /// # Errors
    /// Those of the import, and if the file has no scene of the level.
    pub(crate) fn model(&self, name: &str, json: &Value, file: &[u8]) -> Result<Model, Error> {
        let invalid = |found: String| Error::invalid(name, StageId::Import, found, "bake the model again");
        let scene = self.scene.ok_or_else(|| invalid(format!("it has no scene LOD{}", self.level)))?;
        let bytes = with_default_scene(json, file, scene)
            .ok_or_else(|| invalid("it is no binary glTF, as every output of this program is".into()))?;
        let own = format!("{name}, LOD{}", self.level);
        import(&Source { name: &own, bytes: &bytes, resources: &NoResources }, &ImportLimits::default())
    }
}

/// A binary glTF with another default scene.
fn with_default_scene(json: &Value, file: &[u8], scene: usize) -> Option<Vec<u8>> {
    let length = file.get(HEADER..HEADER + 4)?.try_into().ok().map(u32::from_le_bytes)? as usize;
    let kind = file.get(HEADER + 4..HEADER + CHUNK_HEADER)?;
    let rest = file.get((HEADER + CHUNK_HEADER).checked_add(length)?..).filter(|_| kind == JSON_CHUNK)?;
    let mut json = json.clone();
    json.as_object_mut()?.insert("scene".to_owned(), scene.into());
    let mut text = serde_json::to_vec(&json).ok()?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = u32::try_from(HEADER + CHUNK_HEADER + text.len() + rest.len()).ok()?;
    let mut out = file.get(..8)?.to_vec();
    out.extend(total.to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(JSON_CHUNK);
    out.extend(text);
    out.extend(rest);
    Some(out)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn levels_are_found_by_their_nodes() {
        let document = json!({
            "scenes": [{"name": "LOD1"}, {"name": "LOD1"}, {"name": "LOD2"}],
            "nodes": [
                {"mesh": 0, "extras": {"simpliguard": "other"}},
                {"mesh": 7, "extras": {"simpliguard": {"level": 2, "budget": 20, "faces": 19, "error": 0.5}}},
                {"extras": {"simpliguard": {"level": 1}}},
            ],
        });
        let levels = levels_of(&document);
        assert_eq!(
            levels.iter().map(|l| (l.level, l.scene, l.mesh)).collect::<Vec<_>>(),
            [(1, Some(1), None), (2, Some(2), Some(7))]
        );
        assert_eq!((levels[1].budget, levels[1].faces, levels[1].error), (Some(20), Some(19), Some(0.5)));
        assert!(levels_of(&json!({})).is_empty());
    }

    #[test]
    fn only_the_default_scene_is_replaced() {
        let mut file = b"glTF\x02\0\0\0\x20\0\0\0\x04\0\0\0JSON{}  ".to_vec();
        file.extend(b"rest");
        let out = with_default_scene(&json!({}), &file, 3).expect("a binary glTF");
        assert_eq!(&out[20..32], b"{\"scene\":3} ");
        assert_eq!((&out[32..], u32::from_le_bytes([out[8], out[9], out[10], out[11]])), (&b"rest"[..], 36));
        assert!(with_default_scene(&json!({}), b"{}", 0).is_none());
        assert!(with_default_scene(&json!({}), b"glTF\x02\0\0\0\x20\0\0\0\xff\xff\xff\xffJSON", 0).is_none());
    }
}
