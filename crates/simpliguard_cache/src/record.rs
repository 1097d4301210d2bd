//! Results, and the records that list the objects of a result.

use serde::{Deserialize, Serialize};
use simpliguard_key::Key;

/// Version of the format of records. A record of another version counts as a miss.
const VERSION: u32 = 2;

/// A result: its named objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Names and contents, in the order of storing.
    pub objects: Vec<(String, Vec<u8>)>,
}

impl Entry {
    /// The content of an object.
    pub fn object(&self, name: &str) -> Option<&[u8]> {
        self.objects.iter().find(|(n, _)| n == name).map(|(_, bytes)| bytes.as_slice())
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Record {
    version: u32,
    key: String,
    pub(crate) objects: Vec<ObjectRecord>,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ObjectRecord {
    pub(crate) name: String,
    #[serde(with = "hex")]
    pub(crate) hash: blake3::Hash,
    /// In bytes.
    pub(crate) size: u64,
}

/// The field that records of all versions have.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

impl Record {
    pub(crate) fn new(key: &Key, objects: Vec<ObjectRecord>) -> Self {
        Self { version: VERSION, key: key.hex(), objects }
    }

    pub(crate) fn to_json(&self) -> Result<Vec<u8>, serde_json::Error> {
        serde_json::to_vec_pretty(self)
    }

    /// The record of a key, given by its hexadecimal digits. `None` if the record has another version. `Err` describes
    /// the damage.
    pub(crate) fn parse(json: &[u8], key: &str) -> Result<Option<Self>, String> {
        let malformed = |e: serde_json::Error| format!("is no record ({e})");
        if serde_json::from_slice::<Version>(json).map_err(malformed)?.version != VERSION {
            return Ok(None);
        }
        let record: Self = serde_json::from_slice(json).map_err(malformed)?;
        if record.key == key { Ok(Some(record)) } else { Err("is the record of another key".into()) }
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

#[cfg(test)]
mod tests {
    use simpliguard_key::KeyBuilder;

    use super::*;

    #[test]
    fn a_record_of_another_version_is_a_miss_whatever_it_holds() {
        let key = KeyBuilder::new("test").finish();
        for other in [&br#"{"version": 1, "made_by": "cpu", "objects": []}"#[..], br#"{"version": 3, "new": {}}"#] {
            assert!(matches!(Record::parse(other, &key.hex()), Ok(None)));
        }
        let record = Record::new(&key, Vec::new()).to_json().expect("serialises");
        assert!(matches!(Record::parse(&record, &key.hex()), Ok(Some(_))));
        assert!(Record::parse(br#"{"objects": []}"#, &key.hex()).is_err());
    }
}
