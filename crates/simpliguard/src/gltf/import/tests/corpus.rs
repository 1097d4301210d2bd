//! Real and hostile files, where they are at hand.

use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::assert_sound;
use crate::data::Model;
use crate::gltf::{ExportParams, ImportLimits, export, import};
use crate::{Error, NoResources, RelativeUri, Resources, Source};

/// Files below a folder.
struct Folder(PathBuf);

impl Resources for Folder {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        std::fs::read(self.0.join(uri.as_str())).map(Bytes::from).map_err(|error| error.to_string())
    }
}

/// `../shared/assets/<name>` beside the workspace, or `None` with a message.
#[expect(clippy::print_stderr, reason = "a skipped test says so")]
fn assets(name: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/assets")).join(name);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("skipped: {} is absent", path.display());
    None
}

fn import_file(path: &Path) -> Result<Model, Error> {
    let bytes = std::fs::read(path).expect("a readable file");
    let name = path.display().to_string();
    let resources = Folder(path.parent().expect("a file in a folder").to_owned());
    import(&Source { name: &name, bytes: &bytes, resources: &resources }, &ImportLimits::default())
}

#[test]
fn dev_assets_have_their_known_triangle_counts() {
    let Some(folder) = assets("dev") else { return };
    for (name, triangles, textures) in [
        ("brainstem.glb", 61666, 0),
        ("calla_lily_roses.glb", 151292, 4),
        ("cave.glb", 595410, 0),
        ("chess_board.glb", 178848, 8),
        ("cloth_v9.glb", 115200, 1),
        ("eye.glb", 35520, 4),
        ("flight_helmet.glb", 94722, 15),
        ("fox_dense.glb", 36864, 1),
        ("japanese_maple.glb", 198376, 1),
        ("koala.glb", 99994, 0),
        ("lamborghini.glb", 145917, 8),
        ("lantern_knight.glb", 18216, 11),
        ("machine.glb", 50344, 1),
        ("mannequiny.glb", 13932, 0),
        ("steampunk_robot.glb", 23898, 6),
        ("toy_car.glb", 80885, 7),
    ] {
        let model = import_file(&folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_sound(&model);
        // Faces without area go: `machine` has 1.5 % of them.
        let found = model.surface.triangles.len();
        assert!(found <= triangles && found * 100 >= triangles * 98, "{name}: {found} of {triangles} triangles");
        assert_eq!(model.textures.len(), textures, "{name}");
    }
}

#[test]
fn compressed_files_have_their_known_triangle_counts() {
    let Some(folder) = assets("wild") else { return };
    for (name, triangles, textures) in [
        ("anex_room.glb", 47402, 15),
        ("ch03_ktx2.glb", 28106, 2),
        ("dream_apartment.glb", 177934, 0),
        ("farm_cross_slide.glb", 46658, 1),
        ("folio_areas.glb", 60825, 13),
        ("gelatinous_cube.glb", 29767, 9),
        ("ranger_statue.glb", 220297, 0),
        ("red_city.glb", 175648, 1),
        ("road_bike.glb", 276540, 0),
        ("teapots_instancing.glb", 322562, 0),
        ("twisted_tree_webp.glb", 10089, 3),
        ("vricon_tile.glb", 28222, 2),
        ("vroid_avatar.glb", 40792, 23),
        ("../hostile/compressed_variants/bunny_draco_datauri.gltf", 58754, 0),
        ("../hostile/compressed_variants/chess_board_draco.glb", 178848, 8),
        ("../hostile/compressed_variants/toy_car_meshopt_webp_quantized.glb", 80885, 7),
    ] {
        let model = import_file(&folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_sound(&model);
        // Faces without area and duplicate ones go: the avatar has 2.1 % of them.
        let found = model.surface.triangles.len();
        assert!(found <= triangles && found * 100 >= triangles * 97, "{name}: {found} of {triangles} triangles");
        assert_eq!(model.textures.len(), textures, "{name}");
        let glb = export(&model, &[], &ExportParams::default()).expect("exports");
        let again = import(&Source { name, bytes: &glb, resources: &NoResources }, &ImportLimits::default());
        let again = again.unwrap_or_else(|error| panic!("{name}, written again: {error}"));
        assert!(!again.document.decoded && again.surface.positions == model.surface.positions, "{name}");
    }
}

#[test]
fn hostile_files_give_a_sound_model_or_a_message_with_their_name() {
    const SLOWEST: std::time::Duration = std::time::Duration::from_secs(30);
    let Some(folder) = assets("hostile") else { return };
    let mut pending = vec![folder];
    let mut tried = 0;
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(folder).expect("a readable folder") {
            let path = entry.expect("a readable entry").path();
            let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
            if path.is_dir() {
                pending.push(path);
                continue;
            }
            let is_gltf = matches!(extension, "gltf" | "glb");
            if !is_gltf && !matches!(extension, "obj" | "ply") {
                continue;
            }
            tried += 1;
            let begun = std::time::Instant::now();
            match import_file(&path) {
                Ok(model) => {
                    assert!(is_gltf, "{} was taken for a glTF", path.display());
                    assert_sound(&model);
                }
                Err(error) => {
                    let message = error.to_string();
                    assert!(message.contains(&path.display().to_string()) && message.contains("import"), "{message}");
                    assert!(is_gltf || message.contains("not a glTF file"), "{message}");
                }
            }
            assert!(begun.elapsed() < SLOWEST, "{} took {:?}", path.display(), begun.elapsed());
        }
    }
    assert_eq!(tried, 399);
}
