//! Records: which objects make up the result of a key.

use serde::{Deserialize, Serialize};
use simpliguard::Key;

/// Format of the records.
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Record {
    version: u32,
    key: String,
    pub(crate) made_by: String,
    pub(crate) objects: Vec<ObjectRecord>,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ObjectRecord {
    pub(crate) name: String,
    #[serde(with = "hex")]
    pub(crate) hash: blake3::Hash,
    pub(crate) size: u64,
}

impl Record {
    pub(crate) fn new(key: &Key, made_by: &str, objects: Vec<ObjectRecord>) -> Self {
        Self { version: VERSION, key: key.hex(), made_by: made_by.to_owned(), objects }
    }

    pub(crate) fn to_json(&self) -> Result<Vec<u8>, serde_json::Error> {
        serde_json::to_vec_pretty(self)
    }

    /// The record of a key, by its hexadecimal digits; `None` if it is of another version. `Err` says what is wrong with
    /// it.
    pub(crate) fn parse(json: &[u8], key: &str) -> Result<Option<Self>, String> {
        match serde_json::from_slice::<Self>(json) {
            Ok(record) if record.version != VERSION => Ok(None),
            Ok(record) if record.key == key => Ok(Some(record)),
            Ok(_) => Err("is the record of another key".into()),
            Err(e) => Err(format!("is no record ({e})")),
        }
    }
}

mod hex {
    use serde::de::{Deserialize, Deserializer, Error};
    use serde::ser::Serializer;

    pub(super) fn serialize<S: Serializer>(hash: &blake3::Hash, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&hash.to_hex())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<blake3::Hash, D::Error> {
        let hex = String::deserialize(deserializer)?;
        blake3::Hash::from_hex(&hex).map_err(|e| D::Error::custom(format!("malformed hash: {e}")))
    }
}
