//! How large a scene shows its meshes.

use glam::Mat4;
use serde_json::Value;
use simpliguard::data::Document;

use super::arrays::Array;
use crate::inspect::document::index;
use crate::levels::indices;

/// Lengths in the rest pose of a length of one in the mesh of a node, in the mean of all directions.
pub(super) fn scale_of_mesh(document: &Document, node: usize) -> f64 {
    scale_of_skin(document, node).or_else(|| scale_of_node(document, node)).unwrap_or(1.0)
}

fn scale_of_node(document: &Document, node: usize) -> Option<f64> {
    document.node_world.get(node).map(scale)
}

/// The scale of skinned vertices: that of the first joint. `None` without a skin that can be read.
fn scale_of_skin(document: &Document, node: usize) -> Option<f64> {
    let items = |name| document.json.get(name).and_then(Value::as_array);
    let skin = items("skins")?.get(index(items("nodes")?.get(node)?, "skin")?)?;
    let joint = scale_of_node(document, *indices(skin, "joints").first()?)?;
    let Some(matrices) = index(skin, "inverseBindMatrices") else { return Some(joint) };
    let matrices = Array::read(document, matrices)?.floats()?;
    Some(joint * scale(&Mat4::from_cols_slice(matrices.get(..16)?)))
}

fn scale(matrix: &Mat4) -> f64 {
    matrix.as_dmat4().determinant().abs().cbrt()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use serde_json::json;

    use super::*;

    #[test]
    fn a_skinned_mesh_has_the_scale_of_its_joint_and_others_that_of_their_node() {
        let half = Mat4::from_scale(Vec3::splat(0.5));
        let document = Document {
            json: json!({
                "nodes": [{"mesh": 0}, {"mesh": 1, "skin": 0}, {}],
                "skins": [{"joints": [2], "inverseBindMatrices": 0}],
                "accessors": [{"bufferView": 0, "componentType": 5126, "type": "MAT4", "count": 1}],
                "bufferViews": [{"buffer": 0, "byteLength": 64}],
            }),
            buffers: vec![half.to_cols_array().iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>().into()],
            node_world: [Vec3::new(3.0, -3.0, 3.0), Vec3::splat(9.0), Vec3::new(4.0, 8.0, 2.0)]
                .map(Mat4::from_scale)
                .into(),
            ..Document::default()
        };
        let scales = [0, 1, 7].map(|node| scale_of_mesh(&document, node));
        assert!(scales.iter().zip([3.0, 2.0, 1.0]).all(|(found, wanted)| (found - wanted).abs() < 1e-9), "{scales:?}");
    }
}
