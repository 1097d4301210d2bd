//! Bakes that find what earlier ones have left behind: equal to cold ones, and without the stages that did not change.

use std::collections::{HashMap, HashSet};
use std::io::Cursor;
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

use bytes::Bytes;
use image::{ImageFormat, Rgb, RgbImage};
use simpliguard::data::Level;
use simpliguard::settings::{BakeSettings, Candidates, Quality, Resolution, SourceGeometry};
use simpliguard::{Baked, Context, Error, Key, PreviewSink, RelativeUri, Resources, Source, StageStore, bake};

/// Objects by their keys, and what was asked of them.
#[derive(Default)]
struct Store {
    objects: Mutex<HashMap<Key, Bytes>>,
    counts: Mutex<Counts>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    found: usize,
    stored: usize,
}

impl Store {
    /// Since the last call.
    fn counts(&self) -> Counts {
        std::mem::take(&mut self.counts.lock().expect("not poisoned"))
    }
}

impl StageStore for Store {
    fn get(&self, key: &Key) -> Option<Bytes> {
        let found = self.objects.lock().expect("not poisoned").get(key).cloned();
        self.counts.lock().expect("not poisoned").found += usize::from(found.is_some());
        found
    }

    fn put(&self, key: &Key, bytes: &[u8]) {
        self.objects.lock().expect("not poisoned").insert(*key, Bytes::copy_from_slice(bytes));
        self.counts.lock().expect("not poisoned").stored += 1;
    }
}

/// A bumpy ball in three files.
struct Ball {
    gltf: Vec<u8>,
    bin: Bytes,
    png: Bytes,
}

const RINGS: u32 = 24;

impl Ball {
    /// Its texture has stripes of a colour.
    fn new(stripes: [u8; 3]) -> Self {
        Self::of(RINGS, stripes)
    }

    /// With `2 * rings * rings` triangles.
    fn of(rings: u32, stripes: [u8; 3]) -> Self {
        let vertices = (0..=rings).flat_map(|i| (0..=rings).map(move |j| (i, j)));
        let (mut positions, mut uvs) = (Vec::new(), Vec::new());
        for (i, j) in vertices {
            let [v, u] = [i, j].map(|n| n as f32 / rings as f32);
            let (theta, phi) = (v * std::f32::consts::PI, u * std::f32::consts::TAU);
            let radius = 1.0 + 0.1 * (5.0 * theta).sin() * (4.0 * phi).cos();
            positions.extend([theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()].map(|x| radius * x));
            uvs.extend([u, v]);
        }
        let corner = |i: u32, j: u32| i * (rings + 1) + j;
        let cells = (0..rings).flat_map(|i| (0..rings).map(move |j| (i, j)));
        let indices: Vec<u32> = cells
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [corner(i, j), corner(i, j + 1), corner(i + 1, j), corner(i + 1, j + 1)];
                [a, b, c, b, d, c]
            })
            .collect();
        let count = positions.len() / 3;
        let bin =
            [bytemuck::cast_slice::<f32, u8>(&positions), bytemuck::cast_slice(&uvs), bytemuck::cast_slice(&indices)];
        let [a, b, c] = bin.map(<[u8]>::len);
        let gltf = serde_json::json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}],
            "textures": [{"source": 0}], "images": [{"uri": "stripes.png"}],
            "buffers": [{"uri": "ball.bin", "byteLength": a + b + c}],
            "bufferViews": [
                {"buffer": 0, "byteLength": a}, {"buffer": 0, "byteOffset": a, "byteLength": b},
                {"buffer": 0, "byteOffset": a + b, "byteLength": c},
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count,
                 "min": [-2, -2, -2], "max": [2, 2, 2]},
                {"bufferView": 1, "componentType": 5126, "type": "VEC2", "count": count},
                {"bufferView": 2, "componentType": 5125, "type": "SCALAR", "count": indices.len()},
            ],
        });
        let texel = |x: u32, _| if (x / 8).is_multiple_of(2) { Rgb(stripes) } else { Rgb([200, 200, 200]) };
        let mut png = Cursor::new(Vec::new());
        RgbImage::from_fn(64, 64, texel).write_to(&mut png, ImageFormat::Png).expect("a PNG");
        let gltf = serde_json::to_vec(&gltf).expect("JSON");
        Self { gltf, bin: bin.concat().into(), png: png.into_inner().into() }
    }

    fn bake(&self, settings: &BakeSettings, stages: Option<&dyn StageStore>) -> Baked {
        self.bake_in(settings, &Context { stages, ..Context::default() }).expect("bakes")
    }

    fn bake_in(&self, settings: &BakeSettings, context: &Context<'_>) -> Result<Baked, Error> {
        bake(&Source { name: "ball.gltf", bytes: &self.gltf, resources: self }, settings, context)
    }
}

impl Resources for Ball {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        match uri.as_str() {
            "ball.bin" => Ok(self.bin.clone()),
            "stripes.png" => Ok(self.png.clone()),
            _ => Err("there is no such file".into()),
        }
    }
}

/// One candidate and two levels.
fn settings() -> BakeSettings {
    BakeSettings {
        faces: vec![100, 200],
        texture_size: 128.into(),
        views: 8,
        view_size: 128,
        refine_steps: 4,
        resolution: Resolution::Cells(32),
        candidates: Candidates::Source,
        ..BakeSettings::preset(Quality::Draft)
    }
}

/// A second candidate, whose shapes look like the first one's: the levels are made from both.
fn with_two_candidates() -> BakeSettings {
    BakeSettings { candidates: Candidates::All, ..settings() }
}

/// Bakes with a store and without: both must be equal.
fn assert_as_cold(ball: &Ball, settings: &BakeSettings, store: &Store) -> Counts {
    store.counts();
    let (warm, cold) = (ball.bake(settings, Some(store)), ball.bake(settings, None));
    assert!(warm.glb == cold.glb, "a stored object changed the result");
    assert_eq!(warm.report.levels, cold.report.levels);
    store.counts()
}

#[test]
fn later_stages_find_the_shapes_again() {
    let (ball, store) = (Ball::new([200, 0, 0]), Store::default());
    // The candidate and the shapes it leads to; an atlas and the vertices, these twice, for each level.
    assert_eq!(assert_as_cold(&ball, &settings(), &store), Counts { found: 0, stored: 8 });
    let finish = [
        settings(),
        BakeSettings { normal_map: false, ..settings() },
        BakeSettings { source: SourceGeometry::Drop, ..settings() },
    ];
    for changed in finish {
        // The vertices are looked up before and read afterwards.
        assert_eq!(assert_as_cold(&ball, &changed, &store), Counts { found: 7, stored: 0 }, "{changed:?}");
    }
    let descent =
        [BakeSettings { refine_steps: 8, ..settings() }, BakeSettings { texture_smoothness: 1.0, ..settings() }];
    for changed in descent {
        assert_eq!(assert_as_cold(&ball, &changed, &store), Counts { found: 3, stored: 4 }, "{changed:?}");
    }
    let atlas = [BakeSettings { texture_size: 256.into(), ..settings() }, BakeSettings { gutter: 2, ..settings() }];
    for changed in atlas {
        assert_eq!(assert_as_cold(&ball, &changed, &store), Counts { found: 1, stored: 6 }, "{changed:?}");
    }
}

#[test]
fn a_saved_texture_finds_the_roads_again() {
    let store = Store::default();
    Ball::new([200, 0, 0]).bake(&settings(), Some(&store));
    let counts = assert_as_cold(&Ball::new([0, 200, 0]), &settings(), &store);
    // The candidate and the atlases are found. What wins is judged anew, and the vertices move anew.
    assert_eq!(counts, Counts { found: 3, stored: 5 });
    let store = Store::default();
    Ball::new([200, 0, 0]).bake(&with_two_candidates(), Some(&store));
    let counts = assert_as_cold(&Ball::new([0, 200, 0]), &with_two_candidates(), &store);
    // Both candidates; an atlas is made for what was no choice before.
    assert!(counts.found >= 2 && counts.found + counts.stored == 17, "{counts:?}");
}

#[test]
fn levels_with_an_open_choice_are_made_from_both_shapes_and_found_again() {
    let (ball, store) = (Ball::new([200, 0, 0]), Store::default());
    let settings = with_two_candidates();
    // Two candidates and the shapes they lead to; for each level the choice, and an atlas and the vertices of both shapes, these
    // twice.
    assert_eq!(assert_as_cold(&ball, &settings, &store), Counts { found: 0, stored: 17 });
    assert_eq!(assert_as_cold(&ball, &settings, &store).stored, 0);
}

/// What was shown.
#[derive(Default)]
struct Previews(Mutex<Vec<Vec<u8>>>);

impl PreviewSink for Previews {
    fn show(&self, glb: Vec<u8>) {
        self.0.lock().expect("not poisoned").push(glb);
    }
}

#[test]
fn levels_are_shown_before_their_descent_where_their_shapes_are_known() {
    let (store, previews) = (Store::default(), Previews::default());
    let shown = |ball: &Ball, settings: &BakeSettings| {
        let context = Context { stages: Some(&store), preview: Some(&previews), ..Context::default() };
        let baked = ball.bake_in(settings, &context).expect("bakes");
        assert!(baked.glb == ball.bake(settings, None).glb, "a preview changed the result");
        (std::mem::take(&mut *previews.0.lock().expect("not poisoned")), baked)
    };
    let settings = || BakeSettings { views: 16, refine_steps: 30, ..settings() };
    let (red, green) = (Ball::new([200, 0, 0]), Ball::new([0, 200, 0]));
    let (first, red_levels) = shown(&red, &settings());
    assert!(first.is_empty(), "nothing is known at first");
    let (texture, refined) = shown(&green, &settings());
    let [preview] = texture.as_slice() else { panic!("one preview, not {}", texture.len()) };
    let unrefined = BakeSettings { refine: false, ..settings() };
    // Its vertices lie where the red one's were moved to.
    let is_where_red_is = |glb: &[u8]| {
        let places: HashSet<&[u8]> = (0..glb.len() / 4 - 2).map(|word| &glb[4 * word..4 * word + 12]).collect();
        let holds = |level: &Level| level.mesh.positions.iter().all(|p| places.contains(bytemuck::bytes_of(p)));
        red_levels.levels.iter().map(holds).collect::<Vec<_>>()
    };
    assert_eq!(is_where_red_is(&red_levels.glb), [true; 2]);
    assert_eq!(is_where_red_is(preview), [true; 2]);
    assert_eq!(is_where_red_is(&refined.glb), [false; 2]);
    assert_eq!(is_where_red_is(&green.bake(&unrefined, None).glb), [false; 2]);
    assert_eq!(shown(&green, &BakeSettings { refine_steps: 31, ..settings() }).0.len(), 1);
    assert!(shown(&green, &BakeSettings { normal_map: false, ..settings() }).0.is_empty(), "the descent is known");
    assert!(shown(&red, &unrefined).0.is_empty(), "the result is all there is");
}

#[test]
fn a_change_of_form_finds_nothing() {
    let store = Store::default();
    let mut ball = Ball::new([200, 0, 0]);
    ball.bake(&with_two_candidates(), Some(&store));
    let mut bin = ball.bin.to_vec();
    // The y of a vertex at the equator.
    let at = 12 * (12 * (RINGS as usize + 1) + 3) + 4;
    bin[at..at + 4].copy_from_slice(&0.5f32.to_le_bytes());
    ball.bin = bin.into();
    // The choice of one of the two levels is open.
    assert_eq!(assert_as_cold(&ball, &with_two_candidates(), &store), Counts { found: 0, stored: 14 });
    // Nor does a setting that all candidates read.
    let changed = BakeSettings { visible_weight: 0.5, ..with_two_candidates() };
    assert_eq!(assert_as_cold(&ball, &changed, &store).found, 0);
}

#[test]
fn what_is_no_object_is_made_again() {
    let (ball, store) = (Ball::new([200, 0, 0]), Store::default());
    ball.bake(&settings(), Some(&store));
    for object in store.objects.lock().expect("not poisoned").values_mut() {
        *object = object.slice(..object.len() / 2);
    }
    assert_as_cold(&ball, &settings(), &store);
}

/// Cancels one bake after the other, each a little later, until one is done before its turn comes. They share a store:
/// whatever a bake leaves unfinished behind would show in the end.
#[test]
fn a_cancelled_bake_stops_soon_and_leaves_nothing_unfinished_behind() {
    const STEPS: u32 = 8;
    let (ball, store) = (Ball::of(200, [200, 0, 0]), Store::default());
    let settings = BakeSettings { views: 16, view_size: 256, refine_steps: 100, ..settings() };
    let start = Instant::now();
    let cold = ball.bake(&settings, None);
    let whole = start.elapsed();
    let mut longest = Duration::ZERO;
    for step in 0..STEPS {
        let context = Context { stages: Some(&store), ..Context::default() };
        let cancellation = context.cancellation.clone();
        let canceller = thread::spawn(move || {
            thread::sleep(whole * step / STEPS);
            cancellation.cancel();
            Instant::now()
        });
        let result = ball.bake_in(&settings, &context);
        let end = Instant::now();
        match result {
            Err(Error::Cancelled { asset }) => assert_eq!(asset, "ball.gltf"),
            Err(error) => panic!("{error}"),
            Ok(baked) => assert!(baked.glb == cold.glb, "step {step}"),
        }
        longest = longest.max(end.saturating_duration_since(canceller.join().expect("cancels")));
    }
    assert!(ball.bake(&settings, Some(&store)).glb == cold.glb, "an unfinished object was stored");
    assert!(longest < whole / 3, "{longest:?} from the cancellation to the end, where the whole bake takes {whole:?}");
}
