//! Results, and the records that list the objects of a result.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use simpliguard_key::Key;

/// Version of the format of records. A record of another version counts as a miss.
const VERSION: u32 = 2;

/// Largest size of a record in bytes.
pub(crate) const MOST_RECORD_BYTES: u64 = 64 << 10;
/// Largest size of all objects of a result together, in bytes. It is also the largest size of a binary glTF.
pub(crate) const MOST_RESULT_BYTES: u64 = u32::MAX as u64;
/// Largest number of objects of a result.
const MOST_OBJECTS: usize = 64;
/// Largest length of an object's name in bytes.
const LONGEST_NAME: usize = 100;

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
    pub(crate) key: String,
    pub(crate) objects: Vec<ObjectRecord>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) signature: Option<Signature>,
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

/// The signature of a record.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Signature {
    /// The public key, in hexadecimal digits.
    pub(crate) key: String,
    /// The signature, in hexadecimal digits.
    pub(crate) signature: String,
}

/// The field that records of all versions have.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

impl Record {
    pub(crate) fn new(key: &Key, objects: Vec<ObjectRecord>) -> Self {
        Self { version: VERSION, key: key.hex(), objects, signature: None }
    }

    /// With a signature, or without one.
    pub(crate) fn with_signature(self, signature: Option<Signature>) -> Self {
        Self { signature, ..self }
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
        if record.key != key {
            return Err("is the record of another key".into());
        }
        record.check().map_err(|found| format!("is no record of this program: {found}"))?;
        Ok(Some(record))
    }

    /// Checks everything that this program keeps to when it writes a record.
    fn check(&self) -> Result<(), String> {
        if self.objects.len() > MOST_OBJECTS {
            return Err(format!("it has {} objects", self.objects.len()));
        }
        let mut names = BTreeSet::new();
        for ObjectRecord { name, .. } in &self.objects {
            let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"._- ".contains(&byte);
            if name.is_empty() || name.len() > LONGEST_NAME || !name.bytes().all(is_plain) {
                return Err(format!(
                    "an object has the name {:?}",
                    name.chars().take(LONGEST_NAME).collect::<String>()
                ));
            }
            if !names.insert(name) {
                return Err(format!("two objects have the name {name}"));
            }
        }
        let total = self.objects.iter().fold(0_u64, |sum, object| sum.saturating_add(object.size));
        if total > MOST_RESULT_BYTES { Err(format!("its objects have {total} bytes")) } else { Ok(()) }
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

    #[test]
    fn records_that_this_program_would_not_write_are_refused() {
        let key = KeyBuilder::new("test").finish();
        let parse = |names: &[&str], size| {
            let object = |name: &&str| ObjectRecord { name: (*name).to_owned(), hash: blake3::hash(b""), size };
            let json = Record::new(&key, names.iter().map(object).collect()).to_json().expect("serialises");
            assert!((json.len() as u64) < MOST_RECORD_BYTES);
            Record::parse(&json, &key.hex()).err()
        };
        assert_eq!(parse(&["combined.glb", "level_1000.glb"], 1 << 30), None);
        let long = "a".repeat(101);
        for names in [&["a", "a"][..], &["../a"], &["a\\b"], &[""], &["\x1b[2J"], &[&long], &["a"; 65]] {
            let found = parse(names, 0).expect("refused");
            assert!(found.starts_with("is no record of this program: ") && !found.contains('\x1b'), "{found}");
        }
        assert!(parse(&["a", "b", "c", "d"], 1 << 30).is_some_and(|found| found.contains("4294967296 bytes")));
        let mut most = Record::new(&key, Vec::new());
        let name = |n: usize| format!("{n:0LONGEST_NAME$}");
        most.objects.extend((0..MOST_OBJECTS).map(|n| ObjectRecord {
            name: name(n),
            hash: blake3::hash(b""),
            size: 1,
        }));
        assert!(most.to_json().is_ok_and(|json| json.len() as u64 <= MOST_RECORD_BYTES));
    }
}
