//! The container of a glTF: binary chunks or JSON text, and the JSON inside.

use bytes::Bytes;
use serde_json::Value;

use super::asset::Asset;
use crate::Error;
use crate::gltf::glb::{BIN_CHUNK, CHUNK_HEADER_BYTES, HEADER_BYTES, JSON_CHUNK, MAGIC, UTF8_BOM, VERSION, u32_at};

/// The JSON of a file, and its binary chunk.
#[derive(Debug)]
pub(super) struct Container {
    pub(super) json: Value,
    pub(super) bin: Option<Bytes>,
}

/// Splits `bytes`, parses the JSON and checks that it is glTF 2.
pub(super) fn parse(asset: Asset<'_>, bytes: &[u8]) -> Result<Container, Error> {
    asset.within("the file's size in bytes", bytes.len(), asset.limits.bytes)?;
    let (text, bin) = if bytes.starts_with(MAGIC) { chunks(asset, bytes)? } else { (text(asset, bytes)?, None) };
    let json = json(asset, text)?;
    check_version(asset, &json)?;
    Ok(Container { json, bin: bin.map(Bytes::copy_from_slice) })
}

/// JSON and first BIN chunk of a binary glTF; other chunks are skipped, as the specification asks.
fn chunks<'b>(asset: Asset<'_>, bytes: &'b [u8]) -> Result<(&'b [u8], Option<&'b [u8]>), Error> {
    let (Some(version), Some(length)) = (u32_at(bytes, 4), u32_at(bytes, 8)) else {
        return Err(truncated(asset, "the 12 byte header", bytes.len()));
    };
    if version != VERSION {
        return Err(asset.invalid(format!("it is binary glTF version {version}; version 2 is read")));
    }
    let length = length as usize;
    if bytes.len() < length {
        return Err(truncated(asset, &format!("{length} bytes, as its header says"), bytes.len()));
    }
    let (mut json, mut bin, mut at) = (None, None, HEADER_BYTES);
    while at < length {
        let (Some(size), Some(kind)) = (u32_at(bytes, at), u32_at(bytes, at + 4)) else {
            return Err(truncated(asset, "a chunk header", bytes.len()));
        };
        let (start, size) = (at + CHUNK_HEADER_BYTES, size as usize);
        let Some(data) = bytes[..length].get(start..).and_then(|rest| rest.get(..size)) else {
            let left = length.saturating_sub(start);
            return Err(asset.invalid(format!("the chunk at byte {at} says {size} bytes, but {left} are left")));
        };
        match kind {
            JSON_CHUNK if json.is_none() => json = Some(data),
            BIN_CHUNK if bin.is_none() => bin = Some(data),
            _ => {}
        }
        at = start + size.next_multiple_of(4);
    }
    let json = json.ok_or_else(|| asset.invalid("the binary glTF has no JSON chunk"))?;
    Ok((json, bin))
}

fn truncated(asset: Asset<'_>, what: &str, length: usize) -> Error {
    asset.invalid(format!("the file is truncated: it should hold {what}, but it ends after {length} bytes"))
}

/// The text of a `.gltf`, without a byte order mark.
fn text<'b>(asset: Asset<'_>, bytes: &'b [u8]) -> Result<&'b [u8], Error> {
    let text = bytes.strip_prefix(UTF8_BOM).unwrap_or(bytes);
    match text.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'{') => Ok(text),
        Some(_) => Err(asset.not_gltf("it starts with neither 'glTF' nor '{'")),
        None => Err(asset.not_gltf("it is empty")),
    }
}

/// Parses JSON; nesting beyond 128 levels is refused by the parser.
fn json(asset: Asset<'_>, text: &[u8]) -> Result<Value, Error> {
    // Every value but the first of its list follows a comma, so the commas bound the size of the parsed JSON.
    let commas = text.iter().filter(|&&byte| byte == b',').count();
    asset.within("the number of JSON values", commas, asset.limits.json_values)?;
    let text = text.strip_prefix(UTF8_BOM).unwrap_or(text);
    let end = text.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    let mut json: Value =
        serde_json::from_slice(&text[..end]).map_err(|error| asset.invalid(format!("its JSON is broken: {error}")))?;
    if !json.is_object() {
        return Err(asset.not_gltf("its JSON is not an object"));
    }
    whole_numbers_to_integers(&mut json);
    Ok(json)
}

/// Writes whole floats as integers. JSON has one kind of number, so `3.0` is a valid index, but readers expect `3`.
fn whole_numbers_to_integers(value: &mut Value) {
    match value {
        Value::Number(number) => {
            let Some(float) = number.as_f64().filter(|_| number.is_f64()) else { return };
            let exact = float.fract() == 0.0 && float.abs() < 9.0e15 && (float != 0.0 || float.is_sign_positive());
            if exact {
                *value = Value::from(float as i64);
            }
        }
        Value::Array(items) => items.iter_mut().for_each(whole_numbers_to_integers),
        Value::Object(map) => map.values_mut().for_each(whole_numbers_to_integers),
        Value::Null | Value::Bool(_) | Value::String(_) => {}
    }
}

fn check_version(asset: Asset<'_>, json: &Value) -> Result<(), Error> {
    let Some(header) = json.get("asset") else {
        return Err(asset.not_gltf("its JSON has no 'asset' property"));
    };
    let version = header.get("version").and_then(Value::as_str);
    let needed = header.get("minVersion").and_then(Value::as_str).or(version);
    match (version, needed) {
        (Some(version), Some(needed)) if version.starts_with("2.") && (needed == "2.0" || needed == version) => Ok(()),
        (Some(_), Some(needed)) => Err(asset.invalid(format!("it needs glTF {needed}; glTF 2.0 is read"))),
        _ => Err(asset.invalid("it states no glTF version")),
    }
}
