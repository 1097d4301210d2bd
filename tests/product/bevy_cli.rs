//! `bevy run` and `cargo run` start the game. The Bevy CLI wraps `cargo run` and reads no more than `cargo metadata`, so
//! that is what is checked.

use std::process::Command;

use serde_json::Value;

fn metadata() -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo writes JSON")
}

/// The package whose manifest lies in the workspace's root.
fn root_package(metadata: &Value) -> &Value {
    let manifest = format!("{}/Cargo.toml", metadata["workspace_root"].as_str().expect("a path"));
    let packages = metadata["packages"].as_array().expect("packages");
    packages.iter().find(|package| package["manifest_path"] == manifest.as_str()).expect("the root is a package")
}

fn targets<'a>(package: &'a Value, kind: &str) -> Vec<&'a str> {
    let targets = package["targets"].as_array().expect("targets").iter();
    targets.filter(|target| target["kind"][0] == kind).map(|target| target["name"].as_str().expect("a name")).collect()
}

#[test]
fn one_binary_of_the_workspace_is_the_one_to_run() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages");
    // With several binaries the CLI wants exactly one `default-run`, and cargo wants it in a default member.
    let named: Vec<_> = packages.iter().filter(|package| !package["default_run"].is_null()).collect();
    let [package] = named[..] else { panic!("{} packages with `default-run`", named.len()) };
    assert_eq!(package, root_package(&metadata));
    assert_eq!(package["default_run"], "showcase");
    let with_it = packages.iter().filter(|package| targets(package, "bin").contains(&"showcase")).count();
    assert_eq!((with_it, package["name"].as_str()), (1, Some("showcase")));
    let members = metadata["workspace_default_members"].as_array().expect("default members");
    assert!(members.contains(&package["id"]));
}

#[test]
fn every_platform_and_profile_takes_the_same_features() {
    let metadata = metadata();
    let cli = &root_package(&metadata)["metadata"]["bevy_cli"];
    // Other features or compiler flags than those of `cargo run` would compile Bevy a second time.
    let sections =
        [cli, &cli["dev"], &cli["release"], &cli["native"], &cli["native"]["dev"], &cli["native"]["release"]];
    for section in sections {
        for key in ["features", "default-features", "rustflags", "target"] {
            assert_eq!(section[key], Value::Null, "{key} in {section}");
        }
    }
}

#[test]
fn examples_are_found_without_a_list() {
    let metadata = metadata();
    let mut examples = targets(root_package(&metadata), "example");
    examples.sort_unstable();
    assert_eq!(
        examples,
        [
            "crowd",
            "generate_octopus",
            "headless_bake",
            "minimal",
            "progress_overlay",
            "settings",
            "shipping",
            "village",
            "world"
        ]
    );
}
