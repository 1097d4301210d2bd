//! Levels of models with glass: what is behind stays visible, and the glass keeps its walls and its alpha.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, Vec4};
use serde_json::{Value, json};
use simpliguard::data::{AlphaMode, Level, Model};
use simpliguard::geometry::{BoundingSphere, fibonacci_directions};
use simpliguard::render::{Camera, Image, Light, Renderer, SurfaceSampler};
use simpliguard::settings::{BakeSettings, LevelMaterials, Quality, Resolution};
use simpliguard::{Baked, Context, NoResources, Source, bake};

/// A part of a model: its triangles and the glTF of its material.
type Part = (Vec<[Vec3; 3]>, Value);

/// A sphere of `2 n (n - 1)` triangles around the origin; with `inwards` they face its centre.
fn sphere(radius: f32, n: usize, inwards: bool) -> Vec<[Vec3; 3]> {
    let point = |i: usize, j: usize| {
        let (polar, turn) = (PI * i as f32 / n as f32, TAU * (j % n) as f32 / n as f32);
        radius * Vec3::new(polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin())
    };
    let quad = |(i, j): (usize, usize)| {
        let [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
        [[a, b, c], [a, c, d]].map(|[a, b, c]| if inwards { [a, c, b] } else { [a, b, c] })
    };
    let places = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
    places.flat_map(quad).filter(|[a, b, c]| (*b - *a).cross(*c - *a).length() > 1e-6).collect()
}

fn material(color: [f32; 4], rest: Value) -> Value {
    let mut material = json!({ "pbrMetallicRoughness": { "baseColorFactor": color, "metallicFactor": 0.0 } });
    let rest = rest.as_object().cloned().unwrap_or_default();
    material.as_object_mut().expect("an object").extend(rest);
    material
}

fn blended(alpha: f32) -> Value {
    material([0.2, 0.4, 0.9, alpha], json!({ "alphaMode": "BLEND" }))
}

/// A red ball with a green belt of its own material.
fn ball(radius: f32) -> Vec<Part> {
    let (belt, rest) = sphere(radius, 40, false).into_iter().partition(|t| t.iter().all(|p| p.y.abs() < 0.3 * radius));
    [(belt, [0.1, 0.7, 0.2, 1.0]), (rest, [0.8, 0.1, 0.1, 1.0])]
        .map(|(t, color)| (t, material(color, json!({}))))
        .into()
}

fn glb(parts: &[Part]) -> Vec<u8> {
    let (mut bin, mut views, mut accessors, mut primitives) = (Vec::<u8>::new(), vec![], vec![], vec![]);
    for (i, (triangles, _)) in parts.iter().enumerate() {
        let corners: Vec<[f32; 3]> = triangles.iter().flatten().map(Vec3::to_array).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&corners);
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        accessors.push(json!({ "bufferView": i, "componentType": 5126, "count": corners.len(), "type": "VEC3" }));
        primitives.push(json!({ "attributes": { "POSITION": i }, "material": i }));
        bin.extend_from_slice(bytes);
    }
    let document = json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": primitives }], "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": bin.len() }],
        "materials": parts.iter().map(|(_, material)| material).collect::<Vec<_>>(),
    });
    let json = document.to_string();
    let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
    let header = [0x4654_6C67, 2, 28 + json.len() as u32 + bin.len() as u32, json.len() as u32, 0x4E4F_534A];
    let chunk = [bin.len() as u32, 0x004E_4942];
    [bytemuck::cast_slice(&header), json.as_bytes(), bytemuck::cast_slice(&chunk), bin.as_slice()].concat()
}

fn baked(parts: &[Part]) -> Baked {
    let settings = BakeSettings {
        faces: vec![600],
        views: 12,
        view_size: 128,
        texture_size: 128.into(),
        refine_steps: 0,
        resolution: Resolution::Cells(64),
        materials: LevelMaterials::Baked,
        ..BakeSettings::preset(Quality::Draft)
    };
    let bytes = glb(parts);
    let source = Source { name: "glass.glb", bytes: &bytes, resources: &NoResources };
    bake(&source, &settings, &Context::default()).expect("bakes")
}

/// Mean squared difference of premultiplied colours over six views.
fn error(source: &Model, level: &Level) -> f32 {
    let model = level.to_model(source);
    let frame = BoundingSphere::around(&source.surface.positions);
    let draw = |model: &Model, direction: Vec3| -> Image {
        let sampler = SurfaceSampler::new(model);
        let [image] = Renderer::new(&sampler, 128, 2).draw(&Camera::orbit(&frame, direction, 0.7, 1.0), [Light::None]);
        image
    };
    let of_view = |direction: &Vec3| {
        let (a, b) = (draw(source, *direction), draw(&model, *direction));
        (0..a.pixels.len()).map(|i| (a.at(i) - b.at(i)).length_squared()).sum::<f32>() / a.pixels.len() as f32
    };
    fibonacci_directions(6).iter().map(of_view).sum::<f32>() / 6.0
}

fn alphas(level: &Level) -> Vec<AlphaMode> {
    level.layers.iter().filter_map(|layer| layer.material.baked()).map(|material| material.alpha_mode).collect()
}

#[test]
fn a_ball_under_a_dome_of_glass_is_seen_through_it() {
    let mut parts = ball(0.6);
    parts.push((sphere(1.0, 30, false), blended(0.3)));
    let baked = baked(&parts);
    let (level, report) = (&baked.levels[0], &baked.report.levels[0]);
    assert_eq!(alphas(level), [AlphaMode::Opaque, AlphaMode::Blend]);
    assert!(report.faces > 500 && report.faces <= 600, "{}", report.faces);
    let clear = &report.clear[0];
    assert!((clear.alpha - 0.3).abs() < 0.01 && clear.faces >= 40 && !clear.transmits, "{clear:?}");
    let error = error(baked.model.as_ref().expect("a model"), level);
    assert!(error < 8e-3, "{error}");
}

#[test]
fn both_walls_of_a_bowl_are_kept() {
    let parts = [(sphere(1.0, 30, false), blended(0.4)), (sphere(0.85, 30, true), blended(0.4))];
    let baked = baked(&parts);
    let level = &baked.levels[0];
    assert_eq!(alphas(level), [AlphaMode::Blend]);
    let (inner, outer): (Vec<f32>, Vec<f32>) =
        level.mesh.positions.iter().map(|p| p.length()).partition(|radius| *radius < 0.92);
    assert!(inner.len() > 40 && outer.len() > 40, "{} {}", inner.len(), outer.len());
    let error = error(baked.model.as_ref().expect("a model"), level);
    assert!(error < 5e-3, "{error}");
}

#[test]
fn glass_that_transmits_light_keeps_its_factors() {
    let mut parts = ball(0.6);
    let extensions =
        json!({ "KHR_materials_transmission": { "transmissionFactor": 0.9 }, "KHR_materials_ior": { "ior": 1.3 } });
    parts.push((sphere(1.0, 30, false), material([1.0; 4], json!({ "extensions": extensions }))));
    let baked = baked(&parts);
    let [solid, clear] = &baked.levels[0].layers[..] else { panic!("two layers") };
    let [Some(of_solid), Some(of_clear)] = [solid, clear].map(|layer| layer.material.baked()) else { panic!("baked") };
    assert_eq!((of_solid.transmission, of_clear.alpha_mode), (None, AlphaMode::Opaque));
    let transmission = of_clear.transmission.expect("transmits");
    assert_eq!((transmission.factor, transmission.ior), (0.9, 1.3));
    // The ball is textured as it is, and not with the glass before it.
    let colors = baked.levels[0].to_model(baked.model.as_ref().expect("a model"));
    let sampler = SurfaceSampler::new(&colors);
    let center = |t: usize| sampler.color(t, Vec3::splat(1.0 / 3.0), simpliguard::render::Footprint::new(0.0, 1.0));
    let reds = (0..solid.triangles).map(center).filter(|c: &Vec4| c.x > 0.5 && c.y < 0.3).count();
    assert!(2 * reds > solid.triangles, "{reds} of {}", solid.triangles);
}
