//! A model file of any bytes.

use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, check_binary, external_uris};
use simpliguard::{NoResources, Source};

/// Bytes that an import may take: far more than any small file needs.
const MEMORY: u64 = 256 << 20;

/// Imports the bytes as a model, and asks everything else that is asked of a model before it is imported.
pub fn import(bytes: &[u8]) {
    let source = Source { name: "fuzz.glb", bytes, resources: &NoResources };
    let _ = (check_binary(bytes), external_uris(source.name, bytes));
    import_soundly(&source);
}

/// Imports a model; checks what later stages rely on.
pub(crate) fn import_soundly(source: &Source<'_>) {
    let limits = ImportLimits { memory: MEMORY, ..ImportLimits::default() };
    match simpliguard::gltf::import(source, &limits) {
        Ok(model) => assert_sound(&model),
        Err(error) => assert!(error.to_string().starts_with(source.name), "{error}"),
    }
}

fn assert_sound(model: &Model) {
    let surface = &model.surface;
    let vertices = surface.positions.len();
    assert!(surface.positions.iter().all(|p| p.is_finite()), "a position is not finite");
    assert!(surface.triangles.iter().flatten().all(|&v| (v as usize) < vertices), "an index is out of range");
}
