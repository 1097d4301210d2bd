//! Keys of results and of stored objects.

use std::fmt;

use blake3::hazmat::{self, ChainingValue, HasherExt, Mode};
use serde::Serialize;

use crate::pipeline::stage::Stage;
use crate::{PIPELINE_VERSION, StageId};

/// Separates these keys from every other use of the hash function. The number is that of this encoding.
const CONTEXT: &str = "simpliguard_cache 2026-01 bake key 1";

/// Content from this length on is hashed on all threads.
const PARALLEL_FROM: usize = 1 << 20;
/// What one thread hashes of it.
const PIECE: usize = 1 << 17;

/// The hash of any content; of a large one, on the rayon pool of the caller. `blake3` can do this itself, with a feature
/// that the `blake3` of a game's Bevy would have from then on, too.
pub fn content_hash(content: &[u8]) -> blake3::Hash {
    if content.len() < PARALLEL_FROM {
        return blake3::hash(content);
    }
    let [left, right] = halves(content, 0);
    hazmat::merge_subtrees_root(&left, &right, Mode::Hash)
}

fn halves(content: &[u8], offset: u64) -> [ChainingValue; 2] {
    let length = hazmat::left_subtree_len(content.len() as u64);
    let (left, right) = content.split_at(length as usize);
    let (left, right) = rayon::join(|| subtree(left, offset), || subtree(right, offset + length));
    [left, right]
}

fn subtree(content: &[u8], offset: u64) -> ChainingValue {
    if content.len() <= PIECE {
        return blake3::Hasher::new().set_input_offset(offset).update(content).finalize_non_root();
    }
    let [left, right] = halves(content, offset);
    hazmat::merge_subtrees_non_root(&left, &right, Mode::Hash)
}

/// Names the result of a bake, or of one of its stages.
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

    /// The hash itself.
    pub fn as_bytes(&self) -> &[u8; 32] {
        self.0.as_bytes()
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

/// Gathers what decides the bytes of a result: versions, contents and settings, and no path, thread count or backend. The order of calls counts; every part carries its kind and length, so
/// that no two sequences of parts run together.
#[derive(Clone, Debug)]
pub struct KeyBuilder(blake3::Hasher);

impl KeyBuilder {
    /// Starts with the version of the pipeline.
    pub fn new(version: &str) -> Self {
        let mut builder = Self(blake3::Hasher::new_derive_key(CONTEXT));
        builder.part(b'v', version.as_bytes());
        builder
    }

    /// Starts with the versions of the pipeline and of some of its stages.
    pub(crate) fn for_stages(ids: &[StageId]) -> Self {
        let with_stage = |key: Self, id: &StageId| key.stage(&id.to_string(), Stage::of(*id).version);
        ids.iter().fold(Self::new(PIPELINE_VERSION), with_stage)
    }

    /// Adds a stage and its version.
    #[must_use]
    pub(crate) fn stage(mut self, name: &str, version: u32) -> Self {
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

    /// Adds what another key stands for.
    #[must_use]
    pub fn key(mut self, key: &Key) -> Self {
        self.part(b'k', key.as_bytes());
        self
    }

    /// Adds the parameters of a stage: names and values of all fields. A field more, or another value, gives another key.
    ///
    /// # Panics
    /// If the parameters are a map whose keys are no strings.
    #[must_use]
    pub fn params(mut self, params: &impl Serialize) -> Self {
        let json = serde_json::to_vec(params).expect("parameters are structs of plain values");
        self.part(b's', &json);
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
            KeyBuilder::new("2").input(b"a").params(&"x").finish(),
            base().params(&"x").finish(),
            base().params(&"y").finish(),
            base().missing_input().params(&"x").finish(),
            base().input(b"b").params(&"x").finish(),
            base().params(&"x").input(b"b").finish(),
            base().stage("shape", 1).params(&"x").finish(),
            base().stage("shape", 2).params(&"x").finish(),
            base().stage("unwrap", 1).params(&"x").finish(),
            base().key(&KeyBuilder::new("1").finish()).params(&"x").finish(),
        ];
        for (i, a) in keys.iter().enumerate() {
            assert!(keys[..i].iter().all(|b| a != b), "key {i} is not new");
        }
    }

    #[test]
    fn all_threads_find_the_same_hash() {
        let content: Vec<u8> = (0..3 * PARALLEL_FROM).map(|i| (i / 3) as u8).collect();
        for length in [0, PARALLEL_FROM - 1, PARALLEL_FROM, PARALLEL_FROM + 7, 2 * PARALLEL_FROM + PIECE, content.len()]
        {
            assert_eq!(content_hash(&content[..length]), blake3::hash(&content[..length]), "{length} bytes");
        }
    }

    #[test]
    fn the_encoding_is_stable() {
        let key = KeyBuilder::new("1").input(b"a").missing_input().params(&[4]).finish();
        assert_eq!(key.hex(), "1b390d6a4d9b1b9eff82ceb06fcfac63e46e097621605a9d5a43f3a1ca006edb");
        assert_eq!((Key::from_hex(&key.hex()), Key::from_hex("1b")), (Some(key), None));
        let stage = KeyBuilder::new("1").stage("shape", 1).key(&key).input(b"a").finish();
        assert_eq!(stage.hex(), "47968fa6c1f1293ae4dfccf5eaad6daf9efd2cfe6827a6a183911f34151375f5");
    }
}
