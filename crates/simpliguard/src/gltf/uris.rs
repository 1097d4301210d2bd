//! The other files of a glTF, found without an import.
//!
//! Only the JSON is read: a cache key needs the bytes of every file, but none of the geometry.

use std::collections::BTreeSet;
use std::fmt;
use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};

use super::glb::{Fault, MAGIC, split};
use crate::{Error, RelativeUri, StageId};

/// The external files of a `.glb` or `.gltf`: buffers, then images, each once, in the order of the document. `data:`
/// URIs are no files. URIs that break the rules of [`RelativeUri`] are left out, since nothing may be read through
/// them; the import reports them.
///
/// # Errors
/// [`Error::Invalid`] if there is no JSON to read.
pub fn external_uris(asset: &str, bytes: &[u8]) -> Result<Vec<RelativeUri>, Error> {
    let invalid =
        |found: String| Error::invalid(asset, StageId::Import, found, "give or export a .glb or .gltf file again");
    let chunks = split(bytes).map_err(|fault| invalid(describe(fault)))?;
    let Object(files) = serde_json::from_slice::<Object<Files>>(chunks.json)
        .map_err(|e| invalid(format!("its JSON is broken: {e}")))?;
    let mut seen = BTreeSet::new();
    let uris = files.buffers.into_iter().chain(files.images).filter_map(|file| file.uri);
    let relative = uris.filter_map(|uri| RelativeUri::parse(&uri).ok());
    Ok(relative.filter(|uri| seen.insert(uri.clone())).collect())
}

/// Checks that `bytes` are binary glTF 2 that can be read: its chunks, its JSON and its version. The geometry is not read.
///
/// # Errors
/// A description of what is wrong.
pub fn check_binary(bytes: &[u8]) -> Result<(), String> {
    if !bytes.starts_with(MAGIC) {
        return Err("it is no binary glTF".into());
    }
    let chunks = split(bytes).map_err(describe)?;
    let Object(files) =
        serde_json::from_slice::<Object<Files>>(chunks.json).map_err(|e| format!("its JSON is broken: {e}"))?;
    let version = files.asset.and_then(|asset| asset.version);
    if version.is_some_and(|version| version.starts_with("2.")) { Ok(()) } else { Err("it is no glTF 2".into()) }
}

fn describe(fault: Fault) -> String {
    match fault {
        Fault::NotGltf(why) => format!("not a glTF file: {why}"),
        Fault::Broken(found) => found,
    }
}

/// The part of the JSON that is read here. As in the import, the last of several properties with one name counts.
#[derive(Default)]
struct Files {
    asset: Option<Header>,
    buffers: Vec<File>,
    images: Vec<File>,
}

#[derive(Default)]
struct File {
    uri: Option<String>,
}

#[derive(Default)]
struct Header {
    version: Option<String>,
}

/// Reads the properties of a JSON object one by one.
trait Properties: Default {
    /// Takes the value of the property `name`. `false` if it is not read.
    fn take<'de, A: MapAccess<'de>>(&mut self, name: &str, map: &mut A) -> Result<bool, A::Error>;
}

impl Properties for Files {
    fn take<'de, A: MapAccess<'de>>(&mut self, name: &str, map: &mut A) -> Result<bool, A::Error> {
        match name {
            "asset" => self.asset = Some(map.next_value::<Object<_>>()?.0),
            "buffers" => self.buffers = objects(map.next_value()?),
            "images" => self.images = objects(map.next_value()?),
            _ => return Ok(false),
        }
        Ok(true)
    }
}

impl Properties for File {
    fn take<'de, A: MapAccess<'de>>(&mut self, name: &str, map: &mut A) -> Result<bool, A::Error> {
        if name != "uri" {
            return Ok(false);
        }
        self.uri = map.next_value()?;
        Ok(true)
    }
}

impl Properties for Header {
    fn take<'de, A: MapAccess<'de>>(&mut self, name: &str, map: &mut A) -> Result<bool, A::Error> {
        if name != "version" {
            return Ok(false);
        }
        self.version = map.next_value()?;
        Ok(true)
    }
}

/// A JSON object with some properties.
struct Object<T>(T);

fn objects<T>(objects: Vec<Object<T>>) -> Vec<T> {
    objects.into_iter().map(|Object(object)| object).collect()
}

impl<'de, T: Properties> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ObjectVisitor<T>(PhantomData<T>);

        impl<'de, T: Properties> Visitor<'de> for ObjectVisitor<T> {
            type Value = Object<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a JSON object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Object<T>, A::Error> {
                let mut object = T::default();
                while let Some(name) = map.next_key::<String>()? {
                    if !object.take(&name, &mut map)? {
                        map.next_value::<IgnoredAny>()?;
                    }
                }
                Ok(Object(object))
            }
        }

        deserializer.deserialize_map(ObjectVisitor(PhantomData))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gltf::glb::UTF8_BOM;
    use crate::gltf::{ImportLimits, import};
    use crate::{NoResources, Source};

    const JSON: &str = r#"{"asset":{"version":"2.0"},"images":[{"uri":"t%20x.png"},{"bufferView":0},{"uri":"../no.png"}],
        "buffers":[{"byteLength":4},{"uri":"a.bin"},{"uri":"data:application/octet-stream;base64,AAAA"},{"uri":"./a.bin"}]}"#;

    fn names(bytes: &[u8]) -> Vec<String> {
        external_uris("a", bytes).expect("valid").iter().map(|u| u.as_str().to_owned()).collect()
    }

    fn glb(json: impl AsRef<[u8]>) -> Vec<u8> {
        let json = json.as_ref();
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend((json.len() as u32 + 20).to_le_bytes());
        bytes.extend((json.len() as u32).to_le_bytes());
        bytes.extend(b"JSON");
        bytes.extend(json);
        bytes
    }

    #[test]
    fn files_are_listed_once_buffers_first() {
        assert_eq!(names(JSON.as_bytes()), ["a.bin", "t x.png"]);
        assert_eq!(names(&glb(JSON)), ["a.bin", "t x.png"]);
        assert_eq!(names(b"{}"), [""; 0]);
        assert_eq!(names(br#"{"images": [{"uri": "a"}], "images": [{"uri": "b", "uri": "c"}]}"#), ["c"]);
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
        assert!(message(b"").contains("it is empty"));
        assert!(message(b"\x89PNG").contains("neither 'glTF' nor '{'"));
        assert!(message(b"glTF\x01\0\0\0").contains("ends after 8 bytes"));
        assert!(message(b"glTF\x01\0\0\0\0\0\0\0\0\0\0\0JSON").contains("glTF version 1"));
    }

    /// A file that uses no feature but those of its container, in every form that writers give it.
    #[test]
    fn the_key_and_the_import_take_the_same_files() {
        let json = r#"{"asset":{"version":"2.0"}}"#.as_bytes();
        let bom = [UTF8_BOM, json].concat();
        let padded = [json, b"\0\0\0"].concat();
        let nested = [&br#"{"asset":{"version":"2.0"},"extras":"#[..], &[b'['; 1000], &[b']'; 1000], b"}"].concat();
        let mut foreign_first = b"glTF\x02\0\0\0\x3b\0\0\0\x04\0\0\0ODD_abcd\x1b\0\0\0JSON".to_vec();
        foreign_first.extend(json);
        let trailing = [&glb(json)[..], b"more"].concat();
        let binary = [json, &bom, &padded, b" ", b"[]"].map(glb);
        let files = binary.into_iter().chain([json.to_vec(), bom, padded, trailing, foreign_first]);
        for bytes in files {
            let source = Source { name: "a", bytes: &bytes, resources: &NoResources };
            let imported = import(&source, &ImportLimits::default());
            let text = String::from_utf8_lossy(&bytes);
            assert_eq!(external_uris("a", &bytes).is_ok(), imported.is_ok(), "{text:?}: {imported:?}");
        }
        assert!(external_uris("a", &glb(nested)).is_ok(), "what is not read is not parsed");
    }

    #[test]
    fn binary_gltf_is_told_from_other_bytes() {
        let json = r#"{"asset":{"version":"2.0"}}"#;
        assert_eq!(check_binary(&glb(json)), Ok(()));
        let truncated = &glb(json)[..40];
        let one = &br#"{"asset":{"version":"1.0"}}"#[..];
        for bytes in [json.as_bytes(), b"MZ\x90\0", b"", b"glTF", truncated, &glb("{"), &glb("{}"), &glb(one)] {
            assert!(check_binary(bytes).is_err(), "{:?}", String::from_utf8_lossy(bytes));
        }
    }
}
