//! Descriptions of the other files of a model in `extras`.

use serde_json::Value;

use crate::gltf::export::builder::Builder;

/// Writes `asset.extras.simpliguard`.
pub(super) fn set_extras(out: &mut Builder, extras: Value) {
    if let Some(asset) = out.json.get_mut("asset") {
        asset["extras"]["simpliguard"] = extras;
    }
}
