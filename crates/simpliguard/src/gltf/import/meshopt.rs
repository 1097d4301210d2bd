//! `EXT_meshopt_compression` and `KHR_meshopt_compression`.
//!
//! The `meshopt` crate decodes compressed buffer views into the fallback buffers that they name. The extension is then
//! removed from the JSON, so that the rest of the import and the export see an ordinary glTF. Fallback buffers with
//! data of their own are used unchanged.

use std::collections::BTreeMap;

use bytes::Bytes;
use serde_json::Value;

use super::asset::Asset;
use super::extensions;
use super::schema::{MeshoptView, Root};
use crate::Error;

const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// True if the file requires the extension, or if any buffer view is compressed.
pub(super) fn is_declared(root: &Root<'_>) -> bool {
    root.extensions_required.iter().any(|name| NAMES.contains(name))
        || root.buffer_views.iter().any(|view| view.extensions.meshopt().is_some())
}

/// Fills the fallback buffers that have no data of their own.
pub(super) fn decode(asset: Asset<'_>, root: &Root<'_>, buffers: &mut [Bytes]) -> Result<(), Error> {
    let mut filled: BTreeMap<usize, Vec<u8>> = BTreeMap::new();
    let mut total = 0usize;
    for (index, view) in root.buffer_views.iter().enumerate() {
        let Some(packed) = view.extensions.meshopt() else { continue };
        let buffer = asset.item(&root.buffers, view.buffer, "buffer")?;
        if !buffers[view.buffer].is_empty() {
            continue;
        }
        let new = if filled.contains_key(&view.buffer) { 0 } else { buffer.byte_length };
        total = total.saturating_add(new).saturating_add(view.byte_length);
        asset.within("the decoded size in bytes of its compressed buffers", total, asset.limits.bytes)?;
        // For a moment, the elements are there in three forms.
        asset.fits("a compressed buffer", 3 * view.byte_length as u64)?;
        if !filled.contains_key(&view.buffer) {
            asset.allocate("a compressed buffer", buffer.byte_length as u64)?;
        }
        let target = filled.entry(view.buffer).or_insert_with(|| vec![0; buffer.byte_length]);
        let target = target.get_mut(view.byte_offset..).and_then(|rest| rest.get_mut(..view.byte_length));
        let Some(target) = target else {
            return Err(asset.invalid(format!("buffer view {index} goes past the end of its buffer")));
        };
        let packed_bytes = asset.item(buffers, packed.buffer, "buffer")?;
        let end = packed.byte_offset.checked_add(packed.byte_length);
        let decoded = end
            .and_then(|end| packed_bytes.get(packed.byte_offset..end))
            .ok_or_else(|| "its compressed bytes go past the end of their buffer".to_owned())
            .and_then(|bytes| unpack(bytes, packed, target.len()))
            .map_err(|why| asset.invalid(format!("compressed buffer view {index}: {why}")))?;
        target.copy_from_slice(&decoded);
    }
    for (buffer, bytes) in filled {
        buffers[buffer] = Bytes::from(bytes);
    }
    Ok(())
}

/// Removes the extension from the JSON.
pub(super) fn remove_extension(json: &mut Value) {
    for list in ["buffers", "bufferViews"] {
        for item in json.get_mut(list).and_then(Value::as_array_mut).into_iter().flatten() {
            extensions::take(item, &NAMES);
        }
    }
    for list in ["extensionsUsed", "extensionsRequired"] {
        extensions::undeclare(json, list, &NAMES);
    }
}

/// Decodes one view and undoes its filter. Sizes are checked first, since the decoder panics on wrong ones.
fn unpack(bytes: &[u8], packed: &MeshoptView<'_>, byte_length: usize) -> Result<Vec<u8>, String> {
    let (count, stride) = (packed.count, packed.byte_stride);
    if count.checked_mul(stride) != Some(byte_length) {
        return Err(format!("{count} elements of {stride} bytes are not its {byte_length} bytes"));
    }
    let broken = |error: ::meshopt::Error| format!("its compressed bytes are broken: {error}");
    let mut out = match (packed.mode, stride) {
        ("ATTRIBUTES", 4..=256) if stride.is_multiple_of(4) => attributes(bytes, count, stride).map_err(broken)?,
        ("TRIANGLES", 2) if count.is_multiple_of(3) => {
            to_bytes(::meshopt::decode_index_buffer::<u16>(bytes, count).map_err(broken)?)
        }
        ("TRIANGLES", 4) if count.is_multiple_of(3) => {
            to_bytes(::meshopt::decode_index_buffer::<u32>(bytes, count).map_err(broken)?)
        }
        ("INDICES", 2) => to_bytes(::meshopt::decode_index_sequence::<u16>(bytes, count).map_err(broken)?),
        ("INDICES", 4) => to_bytes(::meshopt::decode_index_sequence::<u32>(bytes, count).map_err(broken)?),
        (mode, _) => return Err(format!("mode {mode} does not go with {count} elements of {stride} bytes")),
    };
    match (packed.filter.unwrap_or("NONE"), stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => filtered::<[i8; 4]>(&mut out, ::meshopt::decode_filter_oct),
        ("OCTAHEDRAL", 8) => filtered::<[i16; 4]>(&mut out, ::meshopt::decode_filter_oct),
        ("QUATERNION", 8) => filtered::<[i16; 4]>(&mut out, ::meshopt::decode_filter_quat),
        ("EXPONENTIAL", _) if stride.is_multiple_of(4) => {
            filtered::<[u32; 1]>(&mut out, ::meshopt::decode_filter_exp);
        }
        ("COLOR", 4) => filtered::<[u8; 4]>(&mut out, ::meshopt::decode_filter_color),
        ("COLOR", 8) => filtered::<[u16; 4]>(&mut out, ::meshopt::decode_filter_color),
        (filter, _) => return Err(format!("filter {filter} does not go with elements of {stride} bytes")),
    }
    Ok(out)
}

fn to_bytes<T: bytemuck::NoUninit>(indices: Vec<T>) -> Vec<u8> {
    bytemuck::cast_slice(&indices).to_vec()
}

/// Runs `filter` over the elements in place.
fn filtered<T: bytemuck::Pod>(bytes: &mut [u8], filter: impl Fn(&mut [T])) {
    let mut elements: Vec<T> = bytemuck::pod_collect_to_vec(bytes);
    filter(&mut elements);
    bytes.copy_from_slice(bytemuck::cast_slice(&elements));
}

/// A vertex whose size the compiler knows, as the decoder requires.
#[derive(Clone)]
struct Vertex<const N: usize>([u8; N]);

impl<const N: usize> Default for Vertex<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// Decodes vertices of `stride` bytes, a multiple of 4 up to 256.
fn attributes(bytes: &[u8], count: usize, stride: usize) -> ::meshopt::Result<Vec<u8>> {
    fn sized<const N: usize>(bytes: &[u8], count: usize) -> ::meshopt::Result<Vec<u8>> {
        let vertices = ::meshopt::decode_vertex_buffer::<Vertex<N>>(bytes, count)?;
        Ok(vertices.into_iter().flat_map(|vertex| vertex.0).collect())
    }
    macro_rules! by_stride {
        ($($size:literal)*) => {
            match stride {
                $($size => sized::<$size>(bytes, count),)*
                _ => Ok(Vec::new()),
            }
        };
    }
    by_stride!(
        4 8 12 16 20 24 28 32 36 40 44 48 52 56 60 64 68 72 76 80 84 88 92 96 100 104 108 112 116 120 124 128
        132 136 140 144 148 152 156 160 164 168 172 176 180 184 188 192 196 200 204 208 212 216 220 224 228 232
        236 240 244 248 252 256
    )
}
