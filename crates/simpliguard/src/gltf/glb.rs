//! The layout of binary glTF 2.0: a header of 12 bytes, then chunks of a length, a kind and data.

/// The first four bytes of the file.
pub(super) const MAGIC: &[u8; 4] = b"glTF";
/// The version in the header.
pub(super) const VERSION: u32 = 2;
/// Magic, version and length of the file.
pub(super) const HEADER_BYTES: usize = 12;
/// Length and kind of a chunk.
pub(super) const CHUNK_HEADER_BYTES: usize = 8;
/// Kind of the first chunk.
pub(super) const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
/// Kind of the chunk with the data of buffer 0.
pub(super) const BIN_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");

/// Byte order mark that some writers put in front of JSON.
pub(super) const UTF8_BOM: &[u8] = b"\xEF\xBB\xBF";

/// The little-endian number at byte `at`; `None` past the end.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}
