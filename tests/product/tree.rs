//! The packages that a shipped game compiles.

use std::collections::BTreeSet;
use std::process::Command;

/// The packages of `bevy_simpliguard` without its default features, at most `depth` steps away.
fn packages(depth: &str) -> BTreeSet<String> {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--package", "bevy_simpliguard", "--no-default-features", "--edges", "normal", "--offline"])
        .args(["--prefix", "none", "--format", "{p}", "--depth", depth])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("runs cargo");
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    let lines = String::from_utf8(tree.stdout).expect("text");
    lines.lines().filter_map(|line| Some(line.split_whitespace().next()?.to_owned())).collect()
}

#[test]
fn a_shipped_game_has_none_of_the_baking_code() {
    let all = packages("100");
    assert!(all.contains("bevy_asset"), "{all:?}");
    let own = ["simpliguard", "simpliguard_bake", "simpliguard_cache", "simpliguard_key"];
    let others = ["rayon", "rayon-core", "faer", "obvhs", "object_store", "notify"];
    for package in own.into_iter().chain(others) {
        assert!(!all.contains(package), "{package} is compiled");
    }
    // Bevy itself has this one.
    assert!(!packages("1").contains("blake3"), "blake3 is asked for");
}
