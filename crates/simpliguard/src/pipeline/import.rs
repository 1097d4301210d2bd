//! The import, and the files that pass through.

use super::baked::Baked;
use super::overlap;
use super::params::Params;
use super::report::{Report, Status};
use super::runner::Runner;
use super::targets::Targets;
use crate::data::{Model, SMALLEST_EXTENT};
use crate::gltf::{self, ImportLimits};
use crate::{Error, Source, StageId};

/// An imported file.
pub(super) enum Imported {
    /// It gets levels that meet the targets.
    ForLevels(Model, Targets),
    /// It passes through.
    PassesThrough(Baked),
}

/// Imports a source, and decides whether it gets levels.
pub(super) fn import(source: &Source<'_>, params: &Params, run: &Runner<'_>) -> Result<Imported, Error> {
    let mut limits = ImportLimits::default();
    limits.memory = run.context().memory.unwrap_or(limits.memory);
    let imported = run.run(StageId::Import, || gltf::import_in(source, &limits, run.cancellation()))?;
    let pass = |model, status| Ok(Imported::PassesThrough(pass_through(source, model, status, run)?));
    if !params.import.enabled {
        // A disabled file need not be readable, unless it must be made binary.
        let model = if is_binary(source) { imported.ok() } else { Some(imported?) };
        return pass(model, Status::PassThrough);
    }
    let mut model = imported?;
    if model.surface.triangles.is_empty() {
        return pass(Some(model), Status::PassThrough);
    }
    if params.import.keep_lods && gltf::has_levels(&model.document.json) {
        return pass(Some(model), Status::KeptLods);
    }
    let targets = Targets::new(&params.targets, model.surface.triangles.len());
    if targets.budgets().is_empty() {
        return pass(Some(model), Status::SmallEnough);
    }
    check_extent(&model)?;
    model.notes.extend(gltf::describe_scene(&model.document));
    run.time(StageId::Import, || overlap::thin(&mut model, run))?;
    Ok(Imported::ForLevels(model, targets))
}

fn check_extent(model: &Model) -> Result<(), Error> {
    let extent = model.surface.extent();
    if extent >= SMALLEST_EXTENT {
        return Ok(());
    }
    let found = format!("its longest side is {extent:e} metres, below the smallest of {SMALLEST_EXTENT:e}");
    Err(Error::invalid(&model.name, StageId::Import, found, "scale it up; glTF's unit is the metre"))
}

fn is_binary(source: &Source<'_>) -> bool {
    source.bytes.starts_with(b"glTF")
}

/// The source as it is, or as one binary glTF if it is in pieces or compressed.
fn pass_through(source: &Source<'_>, model: Option<Model>, status: Status, run: &Runner<'_>) -> Result<Baked, Error> {
    let in_pieces =
        || !is_binary(source) || gltf::external_uris(source.name, source.bytes).is_ok_and(|uris| !uris.is_empty());
    let packed = model.as_ref().filter(|model| model.document.decoded || in_pieces()).map(super::export::pack);
    Ok(Baked {
        glb: packed.transpose()?.unwrap_or_else(|| source.bytes.to_vec()),
        levels: Vec::new(),
        report: Report::passed_through(status, model.as_ref(), run.seconds()),
        model,
    })
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use glam::Vec3;

    use super::*;
    use crate::pipeline::bake;
    use crate::settings::BakeSettings;
    use crate::{Context, RelativeUri, Resources};

    /// Every file holds one triangle.
    struct Folder;

    impl Resources for Folder {
        fn read(&self, _: &RelativeUri) -> Result<Bytes, String> {
            let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            Ok(Bytes::from(bytemuck::cast_slice(&corners).to_vec()))
        }
    }

    const IN_PIECES: &str = r#"{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": "triangle.bin"}]}"#;

    fn as_glb(json: &str) -> Vec<u8> {
        let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
        let words = [2, 20 + json.len() as u32, json.len() as u32, 0x4E4F_534A];
        [b"glTF", bytemuck::cast_slice(&words), json.as_bytes()].concat()
    }

    #[test]
    fn what_passes_through_needs_no_other_file() {
        for bytes in [IN_PIECES.as_bytes().to_vec(), as_glb(IN_PIECES)] {
            for enabled in [true, false] {
                let settings = BakeSettings { enabled, ..BakeSettings::default() };
                let source = Source { name: "test", bytes: &bytes, resources: &Folder };
                let baked = bake(&source, &settings, &Context::default()).expect("passes");
                assert!(baked.glb.starts_with(b"glTF") && baked.levels.is_empty());
                assert_eq!(gltf::external_uris("test", &baked.glb).expect("glTF"), []);
            }
        }
    }

    #[test]
    fn what_was_decoded_does_not_pass_through_as_it_is() {
        let bytes = as_glb(r#"{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}"#);
        let source = Source { name: "test.glb", bytes: &bytes, resources: &Folder };
        let glb = bake(&source, &BakeSettings::default(), &Context::default()).expect("passes").glb;
        assert!(glb.starts_with(b"glTF") && !glb.windows(5).any(|bytes| bytes == b"draco"));
    }

    #[test]
    fn a_disabled_file_need_not_be_readable() {
        let bytes = as_glb(r#"{"asset": {"version": "2.0"}, "extensionsRequired": ["ACME_splines"]}"#);
        let source = Source { name: "test.glb", bytes: &bytes, resources: &Folder };
        let settings = BakeSettings { enabled: false, ..BakeSettings::default() };
        assert_eq!(bake(&source, &settings, &Context::default()).expect("passes").glb, bytes);
    }

    #[test]
    fn a_model_below_the_range_of_its_areas_is_refused() {
        let mut model = Model::empty("speck.glb");
        model.surface.positions = vec![Vec3::ZERO, Vec3::X * 1e-7, Vec3::Y * 1e-7];
        model.surface.triangles = vec![[0, 1, 2]];
        let error = check_extent(&model).expect_err("too small").to_string();
        assert!(error.starts_with("speck.glb: import: its longest side is 1e-7 metres"), "{error}");
    }
}
