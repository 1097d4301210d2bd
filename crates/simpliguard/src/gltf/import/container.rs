//! The container of a glTF: binary chunks or JSON text, and the JSON inside.

use bytes::Bytes;
use serde_json::Value;

use super::asset::Asset;
use crate::Error;
use crate::gltf::glb::{Chunks, Fault, split};

/// The JSON of a file, and its binary chunk.
#[derive(Debug)]
pub(super) struct Container {
    pub(super) json: Value,
    pub(super) bin: Option<Bytes>,
}

/// Splits `bytes`, parses the JSON and checks that it is glTF 2.
pub(super) fn parse(asset: Asset<'_>, bytes: &[u8]) -> Result<Container, Error> {
    asset.within("the file's size in bytes", bytes.len(), asset.limits.bytes)?;
    let Chunks { json: text, bin } = split(bytes).map_err(|fault| match fault {
        Fault::NotGltf(why) => asset.not_gltf(why),
        Fault::Broken(found) => asset.invalid(found),
    })?;
    asset.allocate("the file", bytes.len() as u64)?;
    let json = json(asset, text)?;
    check_version(asset, &json)?;
    Ok(Container { json, bin: bin.map(Bytes::copy_from_slice) })
}

/// Parses JSON; nesting beyond 128 levels is refused by the parser.
fn json(asset: Asset<'_>, text: &[u8]) -> Result<Value, Error> {
    let estimate = Estimate::of(text);
    asset.within("the number of JSON values", estimate.values, asset.limits.json_values)?;
    asset.within("the memory in bytes of the parsed JSON", estimate.bytes(), asset.limits.json_bytes)?;
    asset.allocate("its JSON", estimate.bytes() as u64)?;
    let mut json: Value =
        serde_json::from_slice(text).map_err(|error| asset.invalid(format!("its JSON is broken: {error}")))?;
    if !json.is_object() {
        return Err(asset.not_gltf("its JSON is not an object"));
    }
    whole_numbers_to_integers(&mut json);
    Ok(json)
}

/// An upper bound of what is in a JSON text, from its punctuation. Punctuation in strings counts, too.
struct Estimate {
    text: usize,
    /// Every value but the first of its list follows a comma.
    values: usize,
    arrays: usize,
    objects: usize,
}

impl Estimate {
    /// Bytes of a value in its list, with the room that the list keeps free.
    const VALUE: usize = 64;
    /// Bytes of a list with one value.
    const ARRAY: usize = 144;
    /// Bytes of an object with one property: it has room for eleven.
    const OBJECT: usize = 640;

    fn of(text: &[u8]) -> Self {
        let mut counts = [0; 256];
        text.iter().for_each(|&byte| counts[usize::from(byte)] += 1);
        let [values, arrays, objects] = [b',', b'[', b'{'].map(|byte| counts[usize::from(byte)]);
        Self { text: text.len(), values, arrays, objects }
    }

    fn bytes(&self) -> usize {
        let Self { text, values, arrays, objects } = self;
        text + values * Self::VALUE + arrays * Self::ARRAY + objects * Self::OBJECT
    }
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
