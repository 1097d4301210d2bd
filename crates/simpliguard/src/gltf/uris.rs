//! The other files of a glTF, found without an import.
//!
//! Only the JSON is read: a cache key needs the bytes of every file, but none of the geometry.

use std::collections::BTreeSet;

use serde::Deserialize;

use super::glb::{CHUNK_HEADER_BYTES, HEADER_BYTES, JSON_CHUNK, MAGIC, UTF8_BOM, VERSION, u32_at};
use crate::{Error, RelativeUri, StageId};

/// Bytes of binary glTF before the JSON.
const GLB_HEADERS: usize = HEADER_BYTES + CHUNK_HEADER_BYTES;

/// The external files of a `.glb` or `.gltf`: buffers, then images, each once, in the order of the document. `data:`
/// URIs are no files. URIs that break the rules of [`RelativeUri`] are left out, since nothing may be read through
/// them; the import reports them.
///
/// # Errors
/// [`Error::Invalid`] if there is no JSON to read.
pub fn external_uris(asset: &str, bytes: &[u8]) -> Result<Vec<RelativeUri>, Error> {
    let files: Files = serde_json::from_slice(json(asset, bytes)?)
        .map_err(|e| invalid(asset, format!("the JSON is malformed: {e}"), "export the file again"))?;
    let mut seen = BTreeSet::new();
    let uris = files.buffers.into_iter().chain(files.images).filter_map(|file| file.uri);
    let relative = uris.filter_map(|uri| RelativeUri::parse(&uri).ok());
    Ok(relative.filter(|uri| seen.insert(uri.clone())).collect())
}

#[derive(Deserialize)]
struct Files {
    #[serde(default)]
    buffers: Vec<File>,
    #[serde(default)]
    images: Vec<File>,
}

#[derive(Deserialize)]
struct File {
    uri: Option<String>,
}

/// The JSON chunk of a binary glTF, or the whole file.
fn json<'a>(asset: &str, bytes: &'a [u8]) -> Result<&'a [u8], Error> {
    if !bytes.starts_with(MAGIC) {
        let text = bytes.strip_prefix(UTF8_BOM).unwrap_or(bytes);
        return match text.trim_ascii_start().first() {
            Some(b'{') => Ok(text),
            Some(_) => Err(invalid(asset, "it is neither binary nor JSON glTF", "give a .glb or .gltf file")),
            None => Err(invalid(asset, "the file is empty", "copy or export it again")),
        };
    }
    let truncated = |needed: usize| {
        let found = format!("the file ends after {} of at least {needed} bytes", bytes.len());
        invalid(asset, found, "copy or export it again")
    };
    let (Some(version), Some(length), Some(kind)) = (u32_at(bytes, 4), u32_at(bytes, 12), u32_at(bytes, 16)) else {
        return Err(truncated(GLB_HEADERS));
    };
    if version != VERSION {
        return Err(invalid(asset, format!("it is glTF version {version}"), "export it as glTF 2.0"));
    }
    if kind != JSON_CHUNK {
        return Err(invalid(asset, "its first chunk is not JSON", "export it again"));
    }
    let end = (length as usize).saturating_add(GLB_HEADERS);
    bytes.get(GLB_HEADERS..end).ok_or_else(|| truncated(end))
}

fn invalid(asset: &str, found: impl Into<String>, advice: &str) -> Error {
    Error::invalid(asset, StageId::Import, found, advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    const JSON: &str = r#"{"asset":{"version":"2.0"},"images":[{"uri":"t%20x.png"},{"bufferView":0},{"uri":"../no.png"}],
        "buffers":[{"byteLength":4},{"uri":"a.bin"},{"uri":"data:application/octet-stream;base64,AAAA"},{"uri":"./a.bin"}]}"#;

    fn names(bytes: &[u8]) -> Vec<String> {
        external_uris("a", bytes).expect("valid").iter().map(|u| u.as_str().to_owned()).collect()
    }

    fn glb(json: &str) -> Vec<u8> {
        let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        bytes.extend((json.len() as u32).to_le_bytes());
        bytes.extend(b"JSON");
        bytes.extend(json.as_bytes());
        bytes
    }

    #[test]
    fn files_are_listed_once_buffers_first() {
        assert_eq!(names(JSON.as_bytes()), ["a.bin", "t x.png"]);
        assert_eq!(names(&glb(JSON)), ["a.bin", "t x.png"]);
        assert_eq!(names(b"{}"), [""; 0]);
    }

    #[test]
    fn every_truncation_is_an_error() {
        let whole = glb(JSON);
        for end in 0..whole.len() {
            assert!(external_uris("a", &whole[..end]).is_err(), "{end} bytes were accepted");
        }
    }

    #[test]
    fn messages_say_what_the_file_is() {
        let message = |bytes: &[u8]| external_uris("a.glb", bytes).expect_err("invalid").to_string();
        assert!(message(b"").contains("the file is empty"));
        assert!(message(b"\x89PNG").contains("neither binary nor JSON glTF"));
        assert!(message(b"glTF\x01\0\0\0").contains("ends after 8 of at least 20 bytes"));
        assert!(message(b"glTF\x01\0\0\0\0\0\0\0\0\0\0\0JSON").contains("glTF version 1"));
    }
}
