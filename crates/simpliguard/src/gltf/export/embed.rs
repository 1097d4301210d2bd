//! The source document as the front of the output: every index kept, every byte in one buffer.

use serde_json::{Map, Value, json};

use super::builder::{Builder, Kind, Target, append_aligned, index, indices};
use super::fault;
use crate::Error;
use crate::model::{Document, Model};

/// Extensions that compress a buffer view: they hold a second reference into a buffer, and leave the uncompressed
/// data to a buffer without bytes.
const COMPRESSED_VIEWS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Where the bytes of a source buffer went.
#[derive(Clone, Copy)]
enum Place {
    /// Into buffer 0, from this offset on.
    Chunk(usize),
    /// Nowhere: it is a fallback without data, now at this index.
    Fallback(usize),
}

/// The source's document with all buffers merged and all images that were read embedded. External images that could
/// not be read keep their URI.
pub(super) fn embed(model: &Model) -> Result<Builder, Error> {
    let Document { json, buffers, images, .. } = &model.document;
    let Some(json) = json.as_object().cloned() else {
        return Err(fault(&model.name, "the source's document is no JSON object"));
    };
    let mut out = Builder { asset: model.name.clone(), json, fallback_buffers: Vec::new(), bin: Vec::new() };
    let mut places = Vec::new();
    let declared = out.json.get("buffers").and_then(Value::as_array).cloned().unwrap_or_default();
    for (buffer, bytes) in declared.into_iter().zip(buffers) {
        if is_fallback(&buffer) {
            places.push(Place::Fallback(out.fallback_buffers.len()));
            out.fallback_buffers.push(buffer);
        } else {
            let length = index(&buffer, "byteLength").unwrap_or(bytes.len()).min(bytes.len());
            places.push(Place::Chunk(append_aligned(&mut out.bin, &bytes[..length])));
        }
    }
    // The binary chunk is buffer 0: a fallback never stands without the compressed data beside it.
    for view in out.all_mut(Kind::BufferView) {
        rebase(view, &places);
        for name in COMPRESSED_VIEWS {
            if let Some(compressed) = view.get_mut("extensions").and_then(|e| e.get_mut(name)) {
                rebase(compressed, &places);
            }
        }
    }
    for (i, image) in images.iter().enumerate() {
        let Some((bytes, mime)) = image else { continue };
        let view = out.push_view(bytes, Target::None);
        if let Some(image) = out.all_mut(Kind::Image).get_mut(i).and_then(Value::as_object_mut) {
            image.remove("uri");
            image.insert("bufferView".into(), json!(view));
            image.insert("mimeType".into(), json!(mime));
        }
    }
    ensure_scene(&mut out.json);
    Ok(out)
}

fn is_fallback(buffer: &Value) -> bool {
    COMPRESSED_VIEWS.iter().any(|name| {
        buffer.get("extensions").and_then(|e| e.get(*name)).and_then(|e| e.get("fallback")) == Some(&json!(true))
    })
}

/// Points a buffer view, or the compressed half of one, to where its bytes went.
fn rebase(view: &mut Value, places: &[Place]) {
    match index(view, "buffer").and_then(|b| places.get(b)) {
        Some(&Place::Chunk(base)) => {
            let offset = index(view, "byteOffset").unwrap_or(0) + base;
            view["buffer"] = json!(0);
            view["byteOffset"] = json!(offset);
        }
        Some(&Place::Fallback(i)) => view["buffer"] = json!(i + 1),
        None => {}
    }
}

/// A document without scenes gets one that holds its roots.
fn ensure_scene(json: &mut Map<String, Value>) {
    if json.get("scenes").and_then(Value::as_array).is_some_and(|s| !s.is_empty()) {
        return;
    }
    let nodes = json.get("nodes").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let mut is_root = vec![true; nodes.len()];
    for child in nodes.iter().flat_map(|n| indices(n, "children")) {
        if let Some(root) = is_root.get_mut(child) {
            *root = false;
        }
    }
    let roots: Vec<usize> = (0..nodes.len()).filter(|&i| is_root[i]).collect();
    let scene = if roots.is_empty() { json!({}) } else { json!({ "nodes": roots }) };
    json.insert("scenes".into(), json!([scene]));
    json.insert("scene".into(), json!(0));
}
