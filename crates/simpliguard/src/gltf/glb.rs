//! The layout of binary glTF 2.0: a header of 12 bytes, then chunks of a length, a kind and data.

use serde_json::Value;

/// The first four bytes of the file.
pub(super) const MAGIC: &[u8; 4] = b"glTF";
/// The version in the header.
const VERSION: u32 = 2;
/// Magic, version and length of the file.
const HEADER_BYTES: usize = 12;
/// Length and kind of a chunk.
const CHUNK_HEADER_BYTES: usize = 8;
/// Kind of the first chunk.
const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
/// Kind of the chunk with the data of buffer 0.
const BIN_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");

/// Byte order mark that some writers put in front of JSON.
pub(super) const UTF8_BOM: &[u8] = b"\xEF\xBB\xBF";

/// The little-endian number at byte `at`; `None` past the end.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

/// The JSON of a glTF, and its binary chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Chunks<'b> {
    /// JSON text without byte order mark and padding.
    pub(super) json: &'b [u8],
    pub(super) bin: Option<&'b [u8]>,
}

/// The reason why a file has no chunks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// It is of another type.
    NotGltf(&'static str),
    /// It breaks the layout.
    Broken(String),
}

/// Splits a `.glb` or `.gltf`. The import and the keys read files through this function alone, so they take the same files.
pub(super) fn split(bytes: &[u8]) -> Result<Chunks<'_>, Fault> {
    if bytes.starts_with(MAGIC) {
        return split_binary(bytes);
    }
    let json = unpadded(bytes);
    match json.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'{') => Ok(Chunks { json, bin: None }),
        Some(_) => Err(Fault::NotGltf("it starts with neither 'glTF' nor '{'")),
        None => Err(Fault::NotGltf("it is empty")),
    }
}

/// JSON and first BIN chunk of a binary glTF; other chunks are skipped, as the specification asks.
fn split_binary(bytes: &[u8]) -> Result<Chunks<'_>, Fault> {
    let (Some(version), Some(length)) = (u32_at(bytes, 4), u32_at(bytes, 8)) else {
        return Err(truncated("the 12 byte header", bytes.len()));
    };
    if version != VERSION {
        return Err(Fault::Broken(format!("it is binary glTF version {version}; version 2 is read")));
    }
    let length = length as usize;
    if bytes.len() < length {
        return Err(truncated(&format!("{length} bytes, as its header says"), bytes.len()));
    }
    let (mut json, mut bin, mut at) = (None, None, HEADER_BYTES);
    while at < length {
        let (Some(size), Some(kind)) = (u32_at(bytes, at), u32_at(bytes, at + 4)) else {
            return Err(truncated("a chunk header", bytes.len()));
        };
        let (start, size) = (at + CHUNK_HEADER_BYTES, size as usize);
        let Some(data) = bytes[..length].get(start..).and_then(|rest| rest.get(..size)) else {
            let left = length.saturating_sub(start);
            return Err(Fault::Broken(format!("the chunk at byte {at} says {size} bytes, but {left} are left")));
        };
        match kind {
            JSON_CHUNK if json.is_none() => json = Some(unpadded(data)),
            BIN_CHUNK if bin.is_none() => bin = Some(data),
            _ => {}
        }
        at = start + size.next_multiple_of(4);
    }
    let json = json.ok_or_else(|| Fault::Broken("the binary glTF has no JSON chunk".into()))?;
    Ok(Chunks { json, bin })
}

/// Size in bytes of the largest binary glTF: its length field has 32 bits.
pub(super) const MAX_BYTES: u64 = u32::MAX as u64;

/// The binary glTF of a document and the data of its buffer, which may be empty.
///
/// # Errors
/// The number of bytes that it would have, if that is 4 GiB or more.
pub fn binary(json: &Value, buffer: &[u8]) -> Result<Vec<u8>, u64> {
    let text = json.to_string();
    let chunks = [(JSON_CHUNK, text.as_bytes(), b' '), (BIN_CHUNK, buffer, 0)];
    let chunks = &chunks[..1 + usize::from(!buffer.is_empty())];
    let bytes = chunks.iter().map(|(_, data, _)| CHUNK_HEADER_BYTES + data.len().next_multiple_of(4)).sum();
    let mut out = header(bytes)?;
    chunks.iter().for_each(|(kind, data, padding)| push_chunk(&mut out, *kind, data, *padding));
    Ok(out)
}

/// The start of a binary glTF with this many bytes of chunks. They follow: [`push_chunk`].
fn header(chunks: usize) -> Result<Vec<u8>, u64> {
    let total = (HEADER_BYTES + chunks) as u64;
    let length = u32::try_from(total).map_err(|_| total)?;
    let mut out = Vec::with_capacity(length as usize);
    out.extend(MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend(length.to_le_bytes());
    Ok(out)
}

/// Appends a chunk, padded to whole words.
fn push_chunk(out: &mut Vec<u8>, kind: u32, data: &[u8], padding: u8) {
    let size = data.len().next_multiple_of(4);
    out.extend((size as u32).to_le_bytes());
    out.extend(kind.to_le_bytes());
    out.extend(data);
    out.resize(out.len() + size - data.len(), padding);
}

fn truncated(what: &str, length: usize) -> Fault {
    Fault::Broken(format!("the file is truncated: it should hold {what}, but it ends after {length} bytes"))
}

/// JSON text without a byte order mark in front and the NULs that some writers pad with.
fn unpadded(text: &[u8]) -> &[u8] {
    let text = text.strip_prefix(UTF8_BOM).unwrap_or(text);
    let end = text.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    &text[..end]
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_document_and_its_buffer_are_padded_to_whole_words() {
        let file = binary(&json!({"scene": 3}), &[1, 2, 3]).expect("a small file");
        let json = &file[HEADER_BYTES + CHUNK_HEADER_BYTES..][..12];
        assert_eq!((file.len(), json), (12 + 8 + 12 + 8 + 4, &b"{\"scene\":3} "[..]));
        assert_eq!(&file[file.len() - 4..], [1, 2, 3, 0]);
        let chunks = split(&file).expect("a binary glTF");
        assert_eq!(chunks, Chunks { json, bin: Some(&[1, 2, 3, 0]) });
        assert_eq!(binary(&json!({}), &[]).expect("a small file").len(), 12 + 8 + 4);
    }
}
