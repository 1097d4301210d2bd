//! A hit, compared with its lower bound: reading and hashing the same bytes. Also the hashing of large files.

use std::fs;
use std::path::PathBuf;

use divan::Bencher;
use divan::counter::BytesCount;
use simpliguard_cache::{Cache, Entry, Key, KeyBuilder, Lookup};
use simpliguard_key::content_hash;
use tempfile::TempDir;

fn main() {
    divan::main();
}

/// Sizes in bytes of the objects of a model of 7 MB: the combined file, three levels, a report.
const SIZES: [usize; 5] = [8 << 20, 1 << 20, 2 << 20, 2 << 20, 4 << 10];
/// Size in bytes of a scanned statue.
const LARGE: usize = 256 << 20;

struct Stored {
    _dir: TempDir,
    cache: Cache,
    key: Key,
    objects: Vec<PathBuf>,
}

impl Stored {
    fn new() -> Self {
        let dir = tempfile::tempdir().expect("tempdir");
        let (cache, key) = (Cache::new(dir.path()), KeyBuilder::new("bench").finish());
        let objects: Vec<_> = SIZES.iter().zip(0..).map(|(&size, i)| (format!("{i}.glb"), bytes(size))).collect();
        let path = |(_, bytes): &(String, Vec<u8>)| {
            let hex = blake3::hash(bytes).to_hex();
            let (first, rest) = hex.split_at(2);
            dir.path().join("objects").join(first).join(rest)
        };
        let paths = objects.iter().map(path).collect();
        cache.put(&key, &Entry { objects }).expect("stores");
        Self { _dir: dir, cache, key, objects: paths }
    }

    fn bytes() -> BytesCount {
        BytesCount::new(SIZES.iter().sum::<usize>())
    }
}

fn bytes(size: usize) -> Vec<u8> {
    (0..size as u64).map(|i| (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8).collect()
}

#[divan::bench]
fn hit(bencher: Bencher<'_, '_>) {
    let stored = Stored::new();
    bencher.counter(Stored::bytes()).bench_local(|| match stored.cache.get(&stored.key) {
        Lookup::Hit(entry) => entry,
        other => panic!("{other:?}"),
    });
}

#[divan::bench]
fn read_and_hash(bencher: Bencher<'_, '_>) {
    let stored = Stored::new();
    bencher.counter(Stored::bytes()).bench_local(|| {
        let read = |path: &PathBuf| fs::read(path).expect("reads");
        let files: Vec<Vec<u8>> = stored.objects.iter().map(read).collect();
        let hashes: Vec<blake3::Hash> = files.iter().map(|bytes| blake3::hash(bytes)).collect();
        (files, hashes)
    });
}

#[divan::bench]
fn hash_on_all_cores(bencher: Bencher<'_, '_>) {
    let content = bytes(LARGE);
    bencher.counter(BytesCount::new(LARGE)).bench_local(|| content_hash(&content));
}

#[divan::bench]
fn hash_on_one_core(bencher: Bencher<'_, '_>) {
    let content = bytes(LARGE);
    bencher.counter(BytesCount::new(LARGE)).bench_local(|| blake3::hash(&content));
}
