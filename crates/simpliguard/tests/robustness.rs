//! Whatever triangles a file holds, the bake ends, in levels that are sound or in a clear error.

use std::f32::consts::TAU;

use glam::Vec3;
use proptest::prelude::*;
use simpliguard::data::TriMesh;
use simpliguard::geometry::Topology;
use simpliguard::settings::{BakeSettings, Quality, Resolution};
use simpliguard::{Baked, Context, Error, NoResources, Source, Status, bake};

/// A binary glTF of one unindexed primitive.
fn glb(triangles: &[[Vec3; 3]]) -> Vec<u8> {
    let corners: Vec<[f32; 3]> = triangles.iter().flatten().map(Vec3::to_array).collect();
    let bin: &[u8] = bytemuck::cast_slice(&corners);
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
            "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}],
            "accessors": [{{"bufferView": 0, "componentType": 5126, "count": {}, "type": "VEC3"}}],
            "bufferViews": [{{"buffer": 0, "byteLength": {len}}}], "buffers": [{{"byteLength": {len}}}]}}"#,
        corners.len(),
        len = bin.len(),
    );
    let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
    let header = [0x4654_6C67, 2, 28 + json.len() as u32 + bin.len() as u32, json.len() as u32, 0x4E4F_534A];
    let chunk = [bin.len() as u32, 0x004E_4942];
    [bytemuck::cast_slice(&header), json.as_bytes(), bytemuck::cast_slice(&chunk), bin].concat()
}

/// As little work as the pipeline does.
fn settings(faces: &[u32]) -> BakeSettings {
    BakeSettings {
        faces: faces.to_vec(),
        views: 8,
        view_size: 128,
        texture_size: 64.into(),
        resolution: Resolution::Cells(32),
        normal_map: false,
        ..BakeSettings::preset(Quality::Draft)
    }
}

fn baked(triangles: &[[Vec3; 3]], settings: &BakeSettings) -> Result<Baked, Error> {
    let bytes = glb(triangles);
    bake(&Source { name: "test.glb", bytes: &bytes, resources: &NoResources }, settings, &Context::default())
}

/// The level's triangles as what they are without texture coordinates.
fn welded(baked: &Baked, level: usize) -> TriMesh {
    let mesh = &baked.levels[level].mesh;
    let mut places: Vec<[u32; 3]> = mesh.positions.iter().map(|p| p.to_array().map(|c| (c + 0.0).to_bits())).collect();
    let of_vertex = places.clone();
    places.sort_unstable();
    places.dedup();
    let place = |v: u32| places.binary_search(&of_vertex[v as usize]).expect("is there") as u32;
    TriMesh {
        positions: places.iter().map(|p| Vec3::from(p.map(f32::from_bits))).collect(),
        triangles: mesh.triangles.iter().map(|t| t.map(place)).collect(),
    }
}

/// `Err` says what is wrong with an outcome.
fn judge(outcome: &Result<Baked, Error>) -> Result<(), String> {
    let baked = match outcome {
        Ok(baked) => baked,
        Err(Error::Invalid { .. }) => return Ok(()),
        Err(error) => return Err(format!("unclear: {error}")),
    };
    for (i, level) in baked.levels.iter().enumerate() {
        let mesh = welded(baked, i);
        let topology = Topology::of(&mesh);
        let count = mesh.triangles.len();
        if count == 0 || count > level.budget as usize {
            return Err(format!("{count} faces of at most {}", level.budget));
        }
        if !topology.is_manifold() || topology.degenerate > 0 {
            return Err(format!("{topology:?}"));
        }
        let numbers = |v: &Vec<Vec3>| v.iter().all(|p| p.is_finite());
        if !numbers(&level.mesh.positions) || !numbers(&level.mesh.normals) || !level.error.is_finite() {
            return Err("not all numbers are finite".into());
        }
    }
    Ok(())
}

fn sound(triangles: &[[Vec3; 3]], settings: &BakeSettings) -> Baked {
    let outcome = baked(triangles, settings);
    judge(&outcome).expect("sound");
    outcome.expect("baked")
}

/// Both sides of a strip of quads around the x axis: a closed box of `n` quads along each of its sides.
fn stick(length: f32, width: f32, n: usize) -> Vec<[Vec3; 3]> {
    let corner = |i: usize, k: usize| {
        let angle = TAU * (k as f32 + 0.5) / 4.0;
        Vec3::new(length * i as f32 / n as f32, width * libm::cosf(angle), width * libm::sinf(angle))
    };
    let quad = |[a, b, c, d]: [Vec3; 4]| [[a, b, c], [a, c, d]];
    let sides = (0..n).flat_map(|i| (0..4).map(move |k| (i, k)));
    let sides = sides.flat_map(|(i, k)| quad([corner(i, k), corner(i, k + 1), corner(i + 1, k + 1), corner(i + 1, k)]));
    let ends = [quad([0, 3, 2, 1].map(|k| corner(0, k))), quad([0, 1, 2, 3].map(|k| corner(n, k)))];
    sides.chain(ends.into_iter().flatten()).collect()
}

fn cube(half: f32) -> Vec<[Vec3; 3]> {
    stick(2.0 * half, half * std::f32::consts::SQRT_2, 1).into_iter().map(|t| t.map(|p| p - Vec3::X * half)).collect()
}

/// `n` by `n` squares in a plane.
fn plane(n: usize) -> Vec<[Vec3; 3]> {
    let at = |x: usize, y: usize| Vec3::new(x as f32, 0.0, y as f32) / n as f32;
    let quads = (0..n * n).map(|i| (i % n, i / n));
    quads
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x, y + 1), at(x + 1, y + 1), at(x + 1, y)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

#[test]
fn a_stick_of_ten_thousand_to_one_stays_thin() {
    let settings = BakeSettings { resolution: Resolution::Auto, ..settings(&[40]) };
    let baked = sound(&stick(1.0, 5e-5, 40), &settings);
    let mesh = welded(&baked, 0);
    let thickness = mesh.positions.iter().map(|p| p.y.abs().max(p.z.abs())).fold(0.0, f32::max);
    assert!(thickness < 2.0 * 5e-5, "{thickness:e}");
    let (low, high) = mesh.bounds();
    assert!(low.x.abs() < 1e-3 && (high.x - 1.0).abs() < 1e-3, "{low} {high}");
}

#[test]
fn a_plane_keeps_its_outline() {
    let baked = sound(&plane(12), &settings(&[20]));
    let (low, high) = welded(&baked, 0).bounds();
    assert!((high - low - Vec3::new(1.0, 0.0, 1.0)).abs().max_element() < 0.03, "{low} {high}");
}

#[test]
fn nested_copies_flips_and_faces_without_area_are_one_solid() {
    let mut soup: Vec<[Vec3; 3]> = [1.0, 0.9, 0.5].into_iter().flat_map(cube).collect();
    soup.extend(soup.clone().iter().map(|&[a, b, c]| [a, c, b]));
    soup.extend(soup.clone());
    soup.extend(cube(1.0).iter().map(|&[a, b, _]| [a, b, b]));
    let baked = sound(&soup, &settings(&[24]));
    let (low, high) = welded(&baked, 0).bounds();
    assert!((low.abs() - 1.0).abs().max_element() < 0.1 && (high - 1.0).abs().max_element() < 0.1, "{low} {high}");
}

#[test]
fn single_triangles_pass_through() {
    let one = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
    assert_eq!(sound(&one, &settings(&[4])).report.status, Status::SmallEnough);
    let nothing = [[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]];
    assert_eq!(sound(&nothing, &settings(&[4])).report.status, Status::PassThrough);
}

/// Triangles that are random, slivers, points, or far out.
fn soup() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
    let corner = || (-1f32..1.0, -1f32..1.0, -1f32..1.0).prop_map(Vec3::from);
    let triangle = (corner(), corner(), corner(), 0u8..8).prop_map(|(a, b, c, kind)| match kind {
        0 => [a, a + (b - a) * 1e-6, c],
        1 => [a, b, a + (b - a) * 0.5 + c * 1e-7],
        2 => [a, b, c * 100.0],
        3 => [a, a, a],
        _ => [a, b, c],
    });
    let copies = prop::sample::select(vec![1usize, 2, 3]);
    (prop::collection::vec(triangle, 6..40), copies, any::<bool>()).prop_map(|(triangles, copies, flip)| {
        let mut all: Vec<[Vec3; 3]> = Vec::new();
        for copy in 0..copies {
            all.extend(triangles.iter().map(|&[a, b, c]| if flip && copy % 2 == 1 { [a, c, b] } else { [a, b, c] }));
        }
        all
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, max_shrink_iters: 16, ..ProptestConfig::default() })]
    #[test]
    fn any_soup_ends_in_sound_levels_or_a_clear_error(
        soup in soup(),
        scale in prop::sample::select(vec![1e-12f32, 1e-5, 1.0, 1e9, 1e30]),
        away in prop::sample::select(vec![0f32, 0.0, 3.0, 1e4]),
        budget in 4u32..40,
    ) {
        let soup: Vec<[Vec3; 3]> = soup.iter().map(|t| t.map(|p| (p + away) * scale)).collect();
        let outcome = baked(&soup, &settings(&[budget]));
        prop_assert!(judge(&outcome).is_ok(), "{:?}", judge(&outcome));
    }
}
