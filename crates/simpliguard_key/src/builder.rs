//! The builder of keys.

use serde::Serialize;

use crate::content::content_hash;
use crate::key::Key;

/// Separates these keys from every other use of the hash function. The number at the end is the version of this
/// encoding.
const CONTEXT: &str = "simpliguard_cache 2026-01 bake key 1";

/// Collects everything that decides the bytes of a result: versions, contents and parameters. Paths, thread counts and
/// backends do not belong here.
///
/// The order of calls counts. Every part carries its kind and its length, so two different sequences of parts never
/// give the same bytes to hash.
#[derive(Clone, Debug)]
pub struct KeyBuilder(blake3::Hasher);

impl KeyBuilder {
    /// Starts with the version of the program that makes the result.
    pub fn new(version: &str) -> Self {
        let mut builder = Self(blake3::Hasher::new_derive_key(CONTEXT));
        builder.part(b'v', version.as_bytes());
        builder
    }

    /// Adds a stage and its version.
    #[must_use]
    pub fn stage(mut self, name: &str, version: u32) -> Self {
        self.part(b'g', &[&version.to_le_bytes(), name.as_bytes()].concat());
        self
    }

    /// Adds the content of an input file.
    #[must_use]
    pub fn input(mut self, content: &[u8]) -> Self {
        self.part(b'i', content_hash(content).as_bytes());
        self
    }

    /// Adds an input file that is referred to but cannot be read.
    #[must_use]
    pub fn missing_input(mut self) -> Self {
        self.part(b'a', &[]);
        self
    }

    /// Adds everything that another key stands for.
    #[must_use]
    pub fn key(mut self, key: &Key) -> Self {
        self.part(b'k', key.as_bytes());
        self
    }

    /// Adds parameters: the names and values of all fields. One more field, or another value, gives another key.
    ///
    /// # Panics
    /// If the parameters contain a map whose keys are not strings.
    #[must_use]
    pub fn params(mut self, params: &impl Serialize) -> Self {
        let json = serde_json::to_vec(params).expect("parameters are structs of plain values");
        self.part(b's', &json);
        self
    }

    /// The key.
    pub fn finish(self) -> Key {
        Key::new(self.0.finalize())
    }

    fn part(&mut self, kind: u8, bytes: &[u8]) {
        self.0.update(&[kind]);
        self.0.update(&(bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_counts() {
        let base = || KeyBuilder::new("1").input(b"a");
        let keys = [
            KeyBuilder::new("2").input(b"a").params(&"x").finish(),
            base().params(&"x").finish(),
            base().params(&"y").finish(),
            base().missing_input().params(&"x").finish(),
            base().input(b"b").params(&"x").finish(),
            base().params(&"x").input(b"b").finish(),
            base().stage("simplify", 1).params(&"x").finish(),
            base().stage("simplify", 2).params(&"x").finish(),
            base().stage("unwrap", 1).params(&"x").finish(),
            base().key(&KeyBuilder::new("1").finish()).params(&"x").finish(),
        ];
        for (i, a) in keys.iter().enumerate() {
            assert!(keys[..i].iter().all(|b| a != b), "key {i} is not new");
        }
    }

    #[test]
    fn the_encoding_is_stable() {
        let base = || KeyBuilder::new("1").input(b"a").missing_input();
        let with_bytes = |mut builder: KeyBuilder, bytes: &[u8]| {
            builder.part(b's', bytes);
            builder.finish()
        };
        assert_eq!(base().params(&[4]).finish(), with_bytes(base(), b"[4]"));
        let key = with_bytes(base(), b"faces=[4]\n");
        assert_eq!(key.hex(), "1b390d6a4d9b1b9eff82ceb06fcfac63e46e097621605a9d5a43f3a1ca006edb");
        assert_eq!((Key::from_hex(&key.hex()), Key::from_hex("1b")), (Some(key), None));
        let stage = KeyBuilder::new("1").stage("shape", 1).key(&key).input(b"a").finish();
        assert_eq!(stage.hex(), "47968fa6c1f1293ae4dfccf5eaad6daf9efd2cfe6827a6a183911f34151375f5");
    }
}
