//! The models in `assets/`, their licences and their settings.

use std::fs;
use std::path::{Path, PathBuf};

use simpliguard::settings::{Layer, Origin, ProjectFile, Resolved, parse_meta, resolve};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn models() -> Vec<PathBuf> {
    let files = fs::read_dir(root().join("assets")).expect("assets is there").map(|f| f.expect("readable").path());
    let mut models: Vec<PathBuf> = files.filter(|f| f.extension().is_some_and(|e| e == "glb")).collect();
    models.sort();
    models
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn project() -> ProjectFile {
    ProjectFile::parse(&text(&root().join(ProjectFile::PATH)), ProjectFile::PATH).expect("the project file is valid")
}

fn settings(model: &Path, profile: Option<&str>) -> Resolved {
    let name = model.file_name().and_then(|n| n.to_str()).expect("names are UTF-8");
    let meta = format!("{name}.meta");
    let overrides =
        parse_meta(&text(&model.with_file_name(&meta)), &meta).expect("valid").expect("is for this processor");
    let mut layers = project().layers(name, profile).expect("the profile exists");
    layers.push(Layer { origin: Origin::Meta { file: meta }, overrides });
    resolve(layers).expect("in range")
}

#[test]
fn every_model_has_a_licence_and_settings_of_its_own() {
    let models = models();
    assert!(models.len() >= 4, "{models:?}");
    let mut seen = Vec::new();
    for model in &models {
        assert!(text(&model.with_extension("license.txt")).contains("CC0 1.0 Universal"), "{}", model.display());
        let settings = settings(model, None).settings;
        assert!(!seen.contains(&settings), "{}: settings equal another model's", model.display());
        seen.push(settings);
    }
}

#[test]
fn every_profile_resolves_for_every_model() {
    for profile in project().profiles.keys() {
        for model in models() {
            assert!(settings(&model, Some(profile)).settings.enabled);
        }
    }
}

#[test]
fn rules_reach_the_models_they_are_meant_for() {
    let warn_below = |model: &str| settings(&root().join("assets").join(model), None).settings.warn_below;
    assert_eq!(warn_below("bed.glb"), 20.0);
    assert_ne!(warn_below("octopus.glb"), 20.0);
}
