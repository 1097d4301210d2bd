//! A flat level that is baked from a flat source in the same place, channel by channel.

use glam::{Affine2, Vec2, Vec3, Vec4};
use image::{DynamicImage, Rgba, RgbaImage};

use super::material::MaterialStatistics;
use super::{BakeTarget, Baker, Channels, Projection, TexelMap, inverted_faces, level_material, pbr_maps, tangents};
use crate::Cancellation;
use crate::data::{
    AlphaMode, Atlas, LevelMesh, LevelTextures, Material, Model, Parts, Surface, Texture, TextureRef, TriMesh, Wrap,
    srgb_to_linear,
};
use crate::geometry::{BoundingSphere, Bvh};
use crate::render::{Camera, SurfaceSample, SurfaceSampler};

const SIZE: usize = 64;

/// The unit square in the plane z = 0, left half in material 0 and right half in material 1, image upright.
fn source(materials: [Material; 2], textures: Vec<Texture>) -> Model {
    let mut surface = Surface::default();
    for (m, left) in [0.0, 0.5].into_iter().enumerate() {
        let first = surface.positions.len() as u32;
        let corners = [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]].map(|[x, y]| Vec2::new(left + x, y));
        surface.positions.extend(corners.map(|p| p.extend(0.0)));
        surface.normals.extend([Vec3::Z; 4]);
        surface.uvs[0].extend(corners.map(|p| Vec2::new(p.x, 1.0 - p.y)));
        surface.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        surface.material.extend([m as u32; 2]);
    }
    Model { surface, materials: materials.to_vec(), textures, ..Model::empty("square") }
}

/// The same square of two triangles, over the whole texture, image upright.
pub(super) fn level() -> (TriMesh, Atlas) {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    let uv = |v: u32| Vec2::new(positions[v as usize].x, 1.0 - positions[v as usize].y);
    let uvs = triangles.iter().map(|t: &[u32; 3]| t.map(uv)).collect();
    (TriMesh { positions: positions.clone(), triangles }, Atlas { uvs, ..Atlas::default() })
}

fn samples(model: &Model) -> Vec<Option<SurfaceSample>> {
    samples_of(model, None)
}

fn samples_of(model: &Model, parts: Option<&Parts>) -> Vec<Option<SurfaceSample>> {
    let (mesh, atlas) = level();
    let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
    let bounding_sphere = BoundingSphere::around(&model.surface.positions);
    let texels = TexelMap::new(&atlas, SIZE);
    let target = BakeTarget { mesh: &mesh, atlas: &atlas, texels: &texels, cards: None, keeps_area: false, parts };
    let sampler = SurfaceSampler::new(model);
    Baker { sampler: &sampler, bvh: &bvh, bounding_sphere }.bake(&target, &Cancellation::default())
}

/// The same as the mesh of a level, with tangents.
pub(super) fn level_mesh() -> LevelMesh {
    let (mesh, atlas) = level();
    let mut level = super::level_mesh((&mesh, &atlas), &[[Vec3::Z; 3]; 2], &[false; 2], &[], &[]);
    level.tangents = tangents(&level);
    level
}

/// The sample at a point of the square.
fn sample_at(samples: &[Option<SurfaceSample>], x: f32, y: f32) -> SurfaceSample {
    let texel = |c: f32| (c * SIZE as f32) as usize;
    samples[texel(1.0 - y) * SIZE + texel(x)].expect("covered")
}

fn images(model: &Model) -> LevelTextures {
    maps(model).0
}

fn maps(model: &Model) -> (LevelTextures, MaterialStatistics) {
    let (_, atlas) = level();
    let samples = samples(model);
    let base = vec![Vec4::ONE; SIZE * SIZE];
    let channels = Channels { normal: true, ..Channels::default() };
    pbr_maps(&level_mesh(), &TexelMap::new(&atlas, SIZE), &samples, &base, channels)
}

fn texture(width: u32, texels: &[[u8; 4]], wrap: Wrap, srgb: bool) -> Texture {
    let image = RgbaImage::from_fn(width, texels.len() as u32 / width, |x, y| Rgba(texels[(y * width + x) as usize]));
    Texture::new(&image, [wrap; 2], srgb)
}

fn texture_ref(texture: usize, transform: Affine2) -> Option<TextureRef> {
    Some(TextureRef { texture, uv_set: 0, transform })
}

fn plain() -> Material {
    Material::default()
}

#[test]
fn each_part_shows_its_own_material() {
    let red = Material { base_color: Vec4::new(1.0, 0.0, 0.0, 1.0), ..plain() };
    let half = Material { base_color_texture: texture_ref(0, Affine2::IDENTITY), ..plain() };
    let samples = samples(&source([red, half], vec![texture(1, &[[128, 0, 0, 255]], Wrap::Repeat, true)]));
    assert_eq!(sample_at(&samples, 0.2, 0.5).color, Vec4::new(1.0, 0.0, 0.0, 1.0));
    let shown = sample_at(&samples, 0.8, 0.5).color;
    assert!((shown.x - srgb_to_linear(128.0 / 255.0)).abs() < 1e-5, "{shown}");
}

#[test]
fn vertex_colours_are_multiplied_on_and_interpolated() {
    let mut model = source([plain(), plain()], Vec::new());
    model.materials[0].base_color = Vec4::new(0.5, 0.5, 0.5, 1.0);
    model.surface.colors = vec![Vec4::ONE; 8];
    // The left half's right side.
    model.surface.colors[1] = Vec4::new(0.0, 1.0, 0.0, 1.0);
    model.surface.colors[2] = Vec4::new(0.0, 1.0, 0.0, 1.0);
    let shown = sample_at(&samples(&model), 0.25, 0.5).color;
    assert!((shown - Vec4::new(0.25, 0.5, 0.25, 1.0)).abs().max_element() < 0.02, "{shown}");
}

#[test]
fn a_palette_shows_one_colour_without_its_neighbours() {
    let palette =
        texture(2, &[[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 9, 9, 255]], Wrap::Clamp, true);
    let painted = Material { base_color_texture: texture_ref(0, Affine2::IDENTITY), ..plain() };
    let mut model = source([painted.clone(), painted], vec![palette]);
    // All corners of a half in the middle of one texel.
    model.surface.uvs[0] = [[0.75, 0.25]; 4].into_iter().chain([[0.25, 0.75]; 4]).map(Vec2::from).collect();
    let samples = samples(&model);
    assert_eq!(sample_at(&samples, 0.2, 0.3).color, Vec4::new(0.0, 1.0, 0.0, 1.0));
    assert_eq!(sample_at(&samples, 0.7, 0.9).color, Vec4::new(0.0, 0.0, 1.0, 1.0));
}

#[test]
fn transformed_textures_wrap_as_their_sampler_says() {
    let stripes = [[0, 0, 0, 255], [255, 255, 255, 255]];
    let twice = Affine2::from_scale(Vec2::new(2.0, 1.0));
    for (wrap, expected) in [(Wrap::Repeat, [0, 1, 0, 1]), (Wrap::Mirror, [0, 1, 1, 0]), (Wrap::Clamp, [0, 1, 1, 1])] {
        let painted = Material { base_color_texture: texture_ref(0, twice), ..plain() };
        let samples = samples(&source([painted.clone(), painted], vec![texture(2, &stripes, wrap, true)]));
        let shown = [0.125, 0.375, 0.625, 0.875].map(|x| sample_at(&samples, x, 0.5).color.x.round() as i32);
        assert_eq!(shown, expected, "{wrap:?}");
    }
}

#[test]
fn one_colour_everywhere_is_a_factor() {
    let pale = Material { base_color: Vec4::new(0.83, 0.82, 0.81, 1.0), ..plain() };
    let model = source([pale.clone(), pale.clone()], Vec::new());
    assert!(images(&model).base_color.is_none());
    let statistics = MaterialStatistics::of(&samples(&model), false);
    assert_eq!(level_material(&statistics, AlphaMode::Opaque, false, false).base_color, pale.base_color);
    // Less than a step of eight bits is still a second colour.
    let other = Material { base_color: Vec4::new(0.829, 0.82, 0.81, 1.0), ..plain() };
    assert!(images(&source([pale, other], Vec::new())).base_color.is_some());
}

#[test]
fn occlusion_roughness_and_metalness_share_an_image() {
    let shiny = Material {
        roughness: 0.5,
        metallic: 1.0,
        metallic_roughness_texture: texture_ref(0, Affine2::IDENTITY),
        occlusion_texture: texture_ref(0, Affine2::IDENTITY),
        occlusion_strength: 0.5,
        ..plain()
    };
    let dull = Material { roughness: 1.0, metallic: 0.0, ..plain() };
    let model = source([shiny, dull], vec![texture(1, &[[102, 204, 51, 255]], Wrap::Repeat, false)]);
    let image = images(&model).occlusion_roughness_metallic.expect("it varies");
    // 1 + 0.5 (0.4 - 1), 0.5 * 0.8, 0.2
    for (x, expected) in [(10, [179, 102, 51]), (50, [255, 255, 0])] {
        let shown = image.get_pixel(x, 30).0;
        assert!((0..3).all(|k| shown[k].abs_diff(expected[k]) <= 1), "{shown:?} {expected:?}");
    }
}

#[test]
fn emission_is_an_image_below_its_brightest() {
    let lamp = Material { emissive: Vec3::new(4.0, 2.0, 0.0), ..plain() };
    let model = source([lamp, plain()], Vec::new());
    let image = images(&model).emissive.expect("it shines");
    let [lit, dark] = [10, 50].map(|x| image.get_pixel(x, 30).0);
    assert_eq!((lit[0], lit[1], dark[0], dark[1]), (255, 255, 0, 0));
}

#[test]
fn equal_emission_everywhere_is_a_factor() {
    let lamp = Material { emissive: Vec3::new(4.0, 2.0, 0.0), ..plain() };
    let (textures, statistics) = maps(&source([lamp.clone(), lamp.clone()], Vec::new()));
    assert!(textures.emissive.is_none());
    assert_eq!(level_material(&statistics, AlphaMode::Opaque, false, false).emissive, lamp.emissive);
}

#[test]
fn what_is_clear_takes_its_material_from_what_shows() {
    let shown = Material { roughness: 0.5, ..plain() };
    let model = source([plain(), shown], Vec::new());
    let mut samples = samples(&model);
    for sample in samples.iter_mut().flatten().filter(|sample| sample.roughness == 1.0) {
        sample.color = Vec4::ZERO;
    }
    let texels = TexelMap::new(&level().1, SIZE);
    let channels = Channels { alpha: true, ..Channels::default() };
    let (textures, statistics) = pbr_maps(&level_mesh(), &texels, &samples, &[Vec4::ONE; SIZE * SIZE], channels);
    assert_eq!((textures.occlusion_roughness_metallic, statistics.roughness), (None, 0.5));
    let image = textures.base_color.expect("its alpha varies");
    assert_eq!([10, 50].map(|x| image.get_pixel(x, 30).0[3]), [0, 255]);
}

#[test]
fn what_does_nothing_but_emit_light_is_fitted_by_its_light() {
    let black = Vec4::new(0.0, 0.0, 0.0, 1.0);
    let glowing = Material { base_color: black, emissive: Vec3::new(0.5, 0.0, 0.0), ..plain() };
    let model = source([glowing, plain()], Vec::new());
    let samples = samples(&model);
    let [glow, matt] = [sample_at(&samples, 0.2, 0.5), sample_at(&samples, 0.8, 0.5)];
    assert_eq!((glow.color, glow.glows, glow.emissive), (Vec4::new(0.5, 0.0, 0.0, 1.0), true, Vec3::ZERO));
    assert_eq!((matt.color, matt.glows), (Vec4::ONE, false));
    // The fitted texture is white: here as light, there as a base colour.
    let images = images(&model);
    let [base_color, emissive] = [images.base_color.map(|image| DynamicImage::from(image).to_rgb8()), images.emissive]
        .map(|image| image.expect("both vary"));
    for (x, base, light) in [(10, 0, 255), (50, 255, 0)] {
        assert_eq!((base_color.get_pixel(x, 30).0[0], emissive.get_pixel(x, 30).0[0]), (base, light));
    }
}

#[test]
fn black_that_shines_brighter_than_white_is_left_to_the_light() {
    let black = Vec4::new(0.0, 0.0, 0.0, 1.0);
    let lamp = Material { base_color: black, emissive: Vec3::new(4.0, 2.0, 0.0), ..plain() };
    let sample = sample_at(&samples(&source([lamp, plain()], Vec::new())), 0.2, 0.5);
    assert_eq!((sample.color, sample.glows, sample.emissive), (black, false, Vec3::new(4.0, 2.0, 0.0)));
}

#[test]
fn a_normal_map_survives_where_level_and_source_lie_alike() {
    let bumpy = |map| {
        let bumpy = Material { normal_texture: texture_ref(0, Affine2::IDENTITY), ..plain() };
        source([bumpy.clone(), bumpy], vec![texture(1, &[map], Wrap::Repeat, false)])
    };
    assert!(images(&bumpy([128, 128, 255, 255])).normal.is_none(), "it is flat");
    for map in [[200, 128, 235, 255], [90, 180, 220, 255]] {
        let model = bumpy(map);
        let expected = Vec3::new(map[0].into(), map[1].into(), map[2].into()) / 255.0 * 2.0 - 1.0;
        let image = images(&model).normal.expect("asked for");
        for x in [10, 50] {
            let shown = Vec3::from(image.get_pixel(x, 30).0.map(|c| f32::from(c) / 255.0 * 2.0 - 1.0));
            assert!(shown.distance(expected.normalize()) < 0.02, "{shown} {expected}");
        }
    }
}

#[test]
fn a_wall_behind_glass_is_shown_by_faces_of_the_wall() {
    let mut model = source([plain(), plain()], Vec::new());
    // Glass of the second material before all of it.
    let glass = Material { base_color: Vec4::new(0.0, 0.0, 1.0, 1.0), ..plain() };
    model.materials.push(glass);
    let first = model.surface.positions.len() as u32;
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.01));
    model.surface.positions.extend(corners);
    model.surface.normals.extend([Vec3::Z; 4]);
    model.surface.uvs[0].extend([Vec2::ZERO; 4]);
    model.surface.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    model.surface.material.extend([2; 2]);
    let colour = |parts| sample_at(&samples_of(&model, parts), 0.3, 0.3).color;
    assert_eq!(colour(None), Vec4::new(0.0, 0.0, 1.0, 1.0));
    let wall = Parts { of_faces: vec![0; 2], of_source: vec![0, 0, 0, 0, 1, 1] };
    assert_eq!(colour(Some(&wall)), plain().base_color);
}

/// The colours that an image of the square from above gives to the texels.
fn projected(model: &Model, size: usize, radius: u32) -> Vec<Option<Vec4>> {
    let (mesh, atlas) = level();
    let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
    let bounding_sphere = BoundingSphere::around(&model.surface.positions);
    let texels = TexelMap::new(&atlas, SIZE);
    let target =
        BakeTarget { mesh: &mesh, atlas: &atlas, texels: &texels, cards: None, keeps_area: false, parts: None };
    let sampler = SurfaceSampler::new(model);
    let cameras = [Camera::orbit(&bounding_sphere, Vec3::Z, 0.6, 1.0)];
    let projection = Projection { cameras: &cameras, size, radius };
    Baker { sampler: &sampler, bvh: &bvh, bounding_sphere }.project(&target, &projection, &Cancellation::default())
}

#[test]
fn a_projection_copies_circles_of_the_texture() {
    let texels: Vec<[u8; 4]> =
        (0..64 * 64u32).map(|i| [2 * (i % 64) as u8 + 90, 2 * (i / 64) as u8 + 90, 0, 255]).collect();
    let painted = Material { base_color_texture: texture_ref(0, Affine2::IDENTITY), ..plain() };
    let model = source([painted.clone(), painted], vec![texture(64, &texels, Wrap::Clamp, true)]);
    let (baked, texels) = (samples(&model), SIZE * SIZE);
    // An image in which the square takes about 45 x 45 pixels: fewer than it has texels.
    let known = |radius| projected(&model, 64, radius).iter().flatten().count();
    let [single, small, whole] = [0, 1, 2].map(known);
    assert!(single < texels * 6 / 10 && small > 3 * single / 2 && whole == texels, "{single} {small} {whole}");
    for (color, baked) in projected(&model, 64, 2).iter().zip(&baked) {
        let (color, baked) = (color.expect("reached"), baked.expect("covered").color);
        // A pixel's point lies up to half a texel off the centre; a texel is two steps of eight bits.
        assert!((color - baked).abs().max_element() < 2.5 / 255.0, "{color} {baked}");
    }
}

#[test]
fn a_projection_leaves_out_what_no_image_shows() {
    let mut model = source([plain(), plain()], Vec::new());
    // The left half is gone.
    model.surface.triangles.drain(..2);
    model.surface.material.drain(..2);
    let colors = projected(&model, 128, 1);
    let known = |x: usize| colors[32 * SIZE + x].is_some();
    assert!(!known(10) && !known(28) && known(34) && known(60));
}

#[test]
fn a_face_is_inverted_where_most_of_the_source_has_its_normals_behind() {
    let sided = |double_sided| Material { double_sided, ..plain() };
    let inverted = |source_sides: bool, level_sides: bool| {
        let mut model = source([sided(source_sides), sided(true)], Vec::new());
        model.surface.normals[..4].fill(-Vec3::Z);
        inverted_faces(&TexelMap::new(&level().1, SIZE), &samples(&model), &[level_sides; 2])
    };
    // Three quarters of the second triangle lie on the left half.
    assert_eq!(inverted(true, true), [false, true]);
    assert_eq!(inverted(true, false), [false; 2], "a level that is seen from one side");
    assert_eq!(inverted(false, true), [false; 2], "a source that is seen from one side");
}
