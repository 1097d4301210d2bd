//! `MSFT_lod` with its screen coverages: on which nodes, and with which values.

use serde_json::{Value, json};

use super::builder::{Builder, Kind, indices};
use super::hierarchy::{descendants, scene_roots};

/// Pixels of the screen that coverages are computed for. glTF does not know the screen that a level is seen on.
const SCREEN: [f64; 2] = [1920.0, 1080.0];

/// The least screen coverage of the source and of each level, from the errors of the levels in falling detail: the fraction of
/// the screen that the bounding sphere covers where the error of the next level is one pixel. The last is never left.
pub(in crate::gltf) fn screen_coverages(errors: impl Iterator<Item = f64>) -> Vec<f64> {
    let largest = errors.scan(0.0_f64, |largest, error| {
        *largest = largest.max(error);
        Some(*largest)
    });
    let coverage = |error: f64| {
        let diameter = 1.0 / error;
        let coverage = 0.25 * std::f64::consts::PI * diameter * diameter / (SCREEN[0] * SCREEN[1]);
        // Five digits: nobody measures coverage so well.
        (coverage.min(1.0) * 1e5).round() / 1e5
    };
    largest.map(coverage).chain([0.0]).collect()
}

/// Removes `MSFT_lod` and its screen coverages from every node and material. Returns the nodes that it named.
pub(in crate::gltf) fn remove_lods(out: &mut Builder) -> Vec<usize> {
    let mut named = Vec::new();
    for kind in [Kind::Node, Kind::Material] {
        for object in out.all_mut(kind) {
            let Some(extensions) = object.get_mut("extensions").and_then(Value::as_object_mut) else { continue };
            let Some(lod) = extensions.remove("MSFT_lod") else { continue };
            if kind == Kind::Node {
                named.extend(indices(&lod, "ids"));
            }
            let is_empty = extensions.is_empty();
            let Some(object) = object.as_object_mut() else { continue };
            if is_empty {
                object.remove("extensions");
            }
            if let Some(extras) = object.get_mut("extras").and_then(Value::as_object_mut) {
                extras.remove("MSFT_screencoverage");
                if extras.is_empty() {
                    object.remove("extras");
                }
            }
        }
    }
    if let Some(used) = out.json.get_mut("extensionsUsed").and_then(Value::as_array_mut) {
        used.retain(|name| name != "MSFT_lod");
    }
    named
}

/// Sets `MSFT_lod` and the screen coverages on the only root of the default scene, else on its first root with a mesh under it.
pub(in crate::gltf) fn place_lods(out: &mut Builder, mesh_nodes: &[usize], ids: &[usize], coverages: &[f64]) {
    let roots = scene_roots(out, out.default_scene());
    let has_mesh = |&root: &usize| descendants(out, &[root]).iter().any(|n| mesh_nodes.contains(n));
    let holder = match roots[..] {
        [only] => Some(only),
        _ => roots.iter().copied().find(has_mesh),
    };
    if let Some(node) = holder {
        set_lods(out, node, ids, coverages);
    }
}

/// Sets `MSFT_lod` and the screen coverages of a node.
pub(in crate::gltf) fn set_lods(out: &mut Builder, node: usize, ids: &[usize], coverages: &[f64]) {
    let Some(members) = out.all_mut(Kind::Node).get_mut(node).and_then(Value::as_object_mut) else { return };
    if let Some(extensions) = members.entry("extensions").or_insert_with(|| json!({})).as_object_mut() {
        extensions.insert("MSFT_lod".into(), json!({ "ids": ids }));
    }
    if let Some(extras) = members.entry("extras").or_insert_with(|| json!({})).as_object_mut() {
        extras.insert("MSFT_screencoverage".into(), json!(coverages));
    }
    out.use_extension("MSFT_lod");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverages_fall_and_the_last_level_stays() {
        // At an error of a hundredth, the object is a hundred pixels wide: 7,854 of 2,073,600 pixels.
        let of = |errors: &[f64]| screen_coverages(errors.iter().copied());
        assert_eq!(of(&[0.01, 0.02]), [0.00379, 0.00095, 0.0]);
        assert_eq!(of(&[0.02, 0.01]), [0.00095, 0.00095, 0.0]);
        assert_eq!(of(&[0.0]), [1.0, 0.0]);
    }
}
