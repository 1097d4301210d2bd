//! Tells the crate how far it is optimised: a game compiles it in a profile of its own.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let level = std::env::var("OPT_LEVEL").unwrap_or_default();
    println!("cargo::rustc-env=SIMPLIGUARD_OPT_LEVEL={level}");
}
