//! Cache keys.

use std::fmt;

/// Separates these keys from every other use of the hash function. The number is that of this encoding.
const CONTEXT: &str = "simpliguard_cache 2026-01 bake key 1";

/// Names the result of one bake.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Key(blake3::Hash);

impl Key {
    /// 64 lower-case hexadecimal digits.
    pub fn hex(&self) -> String {
        self.0.to_hex().to_string()
    }

    /// The key that [`Self::hex`] writes.
    pub fn from_hex(hex: &str) -> Option<Self> {
        blake3::Hash::from_hex(hex).ok().map(Self)
    }

    pub(crate) fn hash(&self) -> &blake3::Hash {
        &self.0
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.hex())
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({self})")
    }
}

/// Gathers what decides the bytes of a result. The order of calls counts; every part carries its kind and length, so
/// that no two sequences of parts run together.
#[derive(Clone, Debug)]
pub struct KeyBuilder(blake3::Hasher);

impl KeyBuilder {
    /// Starts with the version of the chain.
    pub fn new(version: &str) -> Self {
        let mut builder = Self(blake3::Hasher::new_derive_key(CONTEXT));
        builder.part(b'v', version.as_bytes());
        builder
    }

    /// Adds the content of an input file.
    #[must_use]
    pub fn input(mut self, content: &[u8]) -> Self {
        self.part(b'i', blake3::hash(content).as_bytes());
        self
    }

    /// Adds an input file that is referred to but cannot be read.
    #[must_use]
    pub fn missing_input(mut self) -> Self {
        self.part(b'a', &[]);
        self
    }

    /// Adds settings in their canonical form.
    #[must_use]
    pub fn settings(mut self, canonical: &[u8]) -> Self {
        self.part(b's', canonical);
        self
    }

    /// The key.
    pub fn finish(self) -> Key {
        Key(self.0.finalize())
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
            KeyBuilder::new("2").input(b"a").settings(b"x").finish(),
            base().settings(b"x").finish(),
            base().settings(b"y").finish(),
            base().missing_input().settings(b"x").finish(),
            base().input(b"b").settings(b"x").finish(),
            base().settings(b"x").input(b"b").finish(),
        ];
        for (i, a) in keys.iter().enumerate() {
            assert!(keys[..i].iter().all(|b| a != b), "key {i} is not new");
        }
    }

    #[test]
    fn the_encoding_is_stable() {
        let key = KeyBuilder::new("1").input(b"a").missing_input().settings(b"faces=[4]\n").finish();
        assert_eq!(key.hex(), "1b390d6a4d9b1b9eff82ceb06fcfac63e46e097621605a9d5a43f3a1ca006edb");
        assert_eq!((Key::from_hex(&key.hex()), Key::from_hex("1b")), (Some(key), None));
    }
}
