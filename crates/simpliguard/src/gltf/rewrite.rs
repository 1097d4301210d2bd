//! Edits of a document whose data was decoded.
//!
//! Decoded bytes go to one new buffer. A view of encoded bytes takes over decoded ones, so that no index changes. Bytes
//! that no view refers to any more are cut out of their buffer.

use std::collections::BTreeSet;

use bytes::Bytes;
use serde_json::{Value, json};

/// Alignment of views, so that every component type is aligned in them.
const ALIGNMENT: usize = 8;

/// A document under edit. [`Self::finish`] must be called.
pub(in crate::gltf) struct Rewrite<'a> {
    pub(in crate::gltf) json: &'a mut Value,
    buffers: &'a mut Vec<Bytes>,
    /// The new buffer.
    bin: Vec<u8>,
    /// Views that hold decoded bytes.
    replaced: BTreeSet<usize>,
    /// Buffers that lost a view.
    touched: BTreeSet<usize>,
}

/// The use of a view of decoded bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gltf) enum ViewUse {
    /// Vertices, with the bytes from one to the next.
    Vertices {
        stride: usize,
    },
    Indices,
    Image,
}

impl<'a> Rewrite<'a> {
    /// Begins edits of `json`, whose `buffers` have one entry each.
    pub(in crate::gltf) fn new(json: &'a mut Value, buffers: &'a mut Vec<Bytes>) -> Self {
        Self { json, buffers, bin: Vec::new(), replaced: BTreeSet::new(), touched: BTreeSet::new() }
    }

    /// The objects of a top-level list.
    pub(in crate::gltf) fn list(&mut self, name: &str) -> &mut Vec<Value> {
        let slot = &mut self.json[name];
        if !slot.is_array() {
            *slot = json!([]);
        }
        slot.as_array_mut().expect("made an array above")
    }

    /// Adds a view of `bytes`; returns its index.
    pub(in crate::gltf) fn push_view(&mut self, bytes: &[u8], view_use: ViewUse) -> usize {
        let view = self.view(bytes, view_use);
        let views = self.list("bufferViews");
        views.push(view);
        views.len() - 1
    }

    /// Lets view `index`, whose bytes were decoded, show `bytes`. A view that already shows decoded bytes keeps them,
    /// and a new one is added. Returns the index of the view that shows `bytes`.
    pub(in crate::gltf) fn replace_view(&mut self, index: usize, bytes: &[u8], view_use: ViewUse) -> usize {
        if !self.replaced.insert(index) {
            return self.push_view(bytes, view_use);
        }
        let view = self.view(bytes, view_use);
        let Some(slot) = self.list("bufferViews").get_mut(index) else { return self.push_view(bytes, view_use) };
        let old = std::mem::replace(slot, view);
        self.touched.extend(number(&old, "buffer"));
        index
    }

    fn view(&mut self, bytes: &[u8], view_use: ViewUse) -> Value {
        let offset = self.bin.len().next_multiple_of(ALIGNMENT);
        self.bin.resize(offset, 0);
        self.bin.extend_from_slice(bytes);
        let mut view = json!({ "buffer": self.buffers.len(), "byteOffset": offset, "byteLength": bytes.len() });
        match view_use {
            ViewUse::Vertices { stride } => {
                view["byteStride"] = json!(stride);
                view["target"] = json!(34962);
            }
            ViewUse::Indices => view["target"] = json!(34963),
            ViewUse::Image => {}
        }
        view
    }

    /// Cuts unused bytes out of the old buffers and adds the new one.
    pub(in crate::gltf) fn finish(mut self) {
        for buffer in std::mem::take(&mut self.touched) {
            self.cut_unused(buffer);
        }
        if !self.bin.is_empty() {
            let bin = std::mem::take(&mut self.bin);
            self.list("buffers").push(json!({ "byteLength": bin.len() }));
            self.buffers.push(Bytes::from(bin));
        }
    }

    /// Cuts out the bytes of a buffer that no view refers to. A buffer with a view past its end stays as it is, for the
    /// message of the check that follows.
    fn cut_unused(&mut self, buffer: usize) {
        let Some(bytes) = self.buffers.get(buffer).cloned() else { return };
        let views = self.list("bufferViews");
        let extents = views.iter().filter(|view| number(view, "buffer") == Some(buffer)).map(extent);
        let Some(ranges) = extents.collect::<Option<Vec<_>>>().and_then(|extents| merged(extents, bytes.len())) else {
            return;
        };
        let mut kept = Vec::new();
        let mut starts = Vec::with_capacity(ranges.len());
        for (start, end) in ranges {
            kept.resize(kept.len().next_multiple_of(ALIGNMENT), 0);
            starts.push((start, kept.len()));
            kept.extend_from_slice(&bytes[start..end]);
        }
        for view in views.iter_mut().filter(|view| number(view, "buffer") == Some(buffer)) {
            let offset = number(view, "byteOffset").unwrap_or_default();
            let range = starts.partition_point(|(start, _)| *start <= offset);
            let Some((start, moved)) = range.checked_sub(1).map(|range| starts[range]) else { continue };
            view["byteOffset"] = json!(offset - start + moved);
        }
        self.list("buffers")[buffer]["byteLength"] = json!(kept.len());
        self.buffers[buffer] = Bytes::from(kept);
    }
}

/// First byte and end of a view in its buffer; `None` past the largest number.
fn extent(view: &Value) -> Option<(usize, usize)> {
    let (offset, length) = (number(view, "byteOffset").unwrap_or_default(), number(view, "byteLength")?);
    Some((offset, offset.checked_add(length)?))
}

/// Ranges that begin at aligned bytes, ascending and apart; `None` if one ends after `length`.
fn merged(mut extents: Vec<(usize, usize)>, length: usize) -> Option<Vec<(usize, usize)>> {
    extents.sort_unstable();
    let mut out: Vec<(usize, usize)> = Vec::with_capacity(extents.len());
    for (start, end) in extents {
        if end > length {
            return None;
        }
        let start = start / ALIGNMENT * ALIGNMENT;
        match out.last_mut() {
            Some(last) if start <= last.1 => last.1 = last.1.max(end),
            _ => out.push((start, end)),
        }
    }
    Some(out)
}

fn number(object: &Value, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).and_then(|number| usize::try_from(number).ok())
}
