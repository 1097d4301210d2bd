//! Texts of settings.

use simpliguard::settings::{
    BakeOverrides, BakeSettings, Layer, Origin, ProjectFile, parse_meta, parse_overrides, resolve,
};

/// Reads the bytes as each kind of a text of settings. What is read is in range, and survives as a text.
pub fn settings(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let _ = parse_meta(text, "fuzz.meta");
    if let Ok(file) = ProjectFile::parse(text, ProjectFile::PATH) {
        let layers = file.layers("props/chair.glb", None).expect("no profile was named");
        assert_in_range(layers);
    }
    if let Ok(overrides) = parse_overrides(text, "fuzz.ron") {
        assert_in_range(vec![Layer { origin: Origin::CommandLine, overrides }]);
    }
    if let Some((name, value)) = text.split_once('=') {
        let mut overrides = BakeOverrides::default();
        if overrides.set(name, value).is_ok() {
            assert_in_range(vec![Layer { origin: Origin::CommandLine, overrides }]);
        }
    }
}

fn assert_in_range(layers: Vec<Layer>) {
    let settings = resolve(layers).expect("what is read is in range").settings;
    let text = settings.to_ron();
    assert_eq!(BakeSettings::from_ron(&text).expect("it was written"), settings, "{text}");
}
