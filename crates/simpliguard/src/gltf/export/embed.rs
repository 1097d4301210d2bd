//! The source document at the front of the output: every index is kept, every byte is in one buffer.

use bytes::Bytes;
use serde_json::{Map, Value, json};

use super::builder::{BufferTarget, Builder, Kind, append_aligned, index, indices};
use super::fault::fault;
use crate::Error;
use crate::data::Document;

/// The source's document with merged buffers and embedded images. External images that could not be read keep their
/// URI.
pub(in crate::gltf) fn embed(asset: &str, document: &Document) -> Result<Builder, Error> {
    let Document { json, buffers, images, .. } = document;
    let Some(json) = json.as_object().cloned() else {
        return Err(fault(asset, "the source's document is no JSON object"));
    };
    let mut out = Builder { asset: asset.to_owned(), json, bin: Vec::new() };
    let bases = merge_buffers(&mut out, buffers);
    for view in out.all_mut(Kind::BufferView) {
        if let Some(base) = index(view, "buffer").and_then(|b| bases.get(b)) {
            let offset = index(view, "byteOffset").unwrap_or(0) + base;
            view["buffer"] = json!(0);
            view["byteOffset"] = json!(offset);
        }
    }
    for (i, image) in images.iter().enumerate() {
        let Some((bytes, mime)) = image else { continue };
        let view = out.push_view(bytes, BufferTarget::None);
        if let Some(image) = out.all_mut(Kind::Image).get_mut(i).and_then(Value::as_object_mut) {
            image.remove("uri");
            image.insert("bufferView".into(), json!(view));
            image.insert("mimeType".into(), json!(mime));
        }
    }
    ensure_scene(&mut out.json);
    Ok(out)
}

/// Appends the buffers that a view refers to; returns the offset of each.
fn merge_buffers(out: &mut Builder, buffers: &[Bytes]) -> Vec<usize> {
    let declared = out.json.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let lengths: Vec<Option<usize>> = declared.iter().map(|b| index(b, "byteLength")).collect();
    let mut used = vec![false; buffers.len()];
    for buffer in out.all(Kind::BufferView).iter().filter_map(|view| index(view, "buffer")) {
        if let Some(used) = used.get_mut(buffer) {
            *used = true;
        }
    }
    let append = |(b, bytes): (usize, &Bytes)| {
        let length = lengths.get(b).copied().flatten().unwrap_or(bytes.len()).min(bytes.len());
        append_aligned(&mut out.bin, if used[b] { &bytes[..length] } else { &[] })
    };
    buffers.iter().enumerate().map(append).collect()
}

/// Adds a scene of all roots to a document without scenes.
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
