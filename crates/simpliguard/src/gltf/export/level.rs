//! One level as glTF: mesh, material and textures.

use glam::{Vec2, Vec3, Vec4};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError, RgbImage};
use serde_json::{Map, Value, json};

use super::builder::{Builder, Component, Kind, Target, number};
use super::skin::{Binding, check_influences};
use super::{fault, vertex_order};
use crate::data::{AlphaMode, Influences, Level, LevelMaterial, LevelMorph, LevelTextures, Model};
use crate::settings::TextureFormat;
use crate::{Context, Error};

/// Vertex counts up to this have 16-bit indices; 65,535 itself is a primitive restart.
const MAX_SHORT_INDEXED: usize = 65_535;

/// Deflate level of the PNGs: within 8 % of the size of level 6 in a fifth of its time.
const PNG_LEVEL: u8 = 3;

/// A level ready to be appended: the work that can run beside other levels is done.
pub(super) struct EncodedLevel {
    vertices: Vertices,
    /// Name and default weight of each morph target.
    targets: Vec<(String, f32)>,
    triangles: Vec<[u32; 3]>,
    material: LevelMaterial,
    base_color: EncodedImage,
    normal: Option<EncodedImage>,
    occlusion_roughness_metallic: Option<EncodedImage>,
    emissive: Option<EncodedImage>,
}

/// An image file.
pub(super) struct EncodedImage {
    pub(super) bytes: Vec<u8>,
    pub(super) mime: &'static str,
}

/// Vertices as they are written: bind space if skinned, else world space.
struct Vertices {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    tangents: Vec<Vec4>,
    uvs: Vec<Vec2>,
    influences: Vec<Influences>,
    morphs: Vec<LevelMorph>,
}

impl EncodedLevel {
    /// Orders vertices and triangles, binds them and encodes the textures.
    pub(super) fn new(
        model: &Model,
        level: &Level,
        binding: Option<&Binding>,
        context: &Context<'_>,
    ) -> Result<Self, Error> {
        check(model, level)?;
        let mesh = &level.mesh;
        let skinned = binding.filter(|_| !mesh.influences.is_empty()).map(|b| b.bind(mesh));
        let uvs = mesh.uvs.clone();
        let mut vertices = match skinned {
            Some(bound) => Vertices {
                positions: bound.positions,
                normals: bound.normals,
                tangents: bound.tangents,
                uvs,
                influences: bound.influences,
                morphs: bound.morphs,
            },
            None => Vertices {
                positions: mesh.positions.clone(),
                normals: mesh.normals.iter().map(|n| n.normalize_or(Vec3::Y)).collect(),
                tangents: mesh.tangents.iter().map(|t| t.truncate().normalize_or(Vec3::X).extend(t.w)).collect(),
                uvs,
                influences: Vec::new(),
                morphs: mesh.morphs.clone(),
            },
        };
        let targets =
            model.surface.morphs.iter().flat_map(|morphs| &morphs.targets).filter(|_| !mesh.morphs.is_empty());
        let targets: Vec<(String, f32)> = targets.map(|target| (target.name.clone(), target.weight)).collect();
        vertices.take_back(targets.iter().map(|(_, weight)| *weight));
        for tangent in &mut vertices.tangents {
            tangent.w = if tangent.w < 0.0 { -1.0 } else { 1.0 };
        }
        let (triangles, order) = vertex_order::optimized(&mesh.triangles, mesh.positions.len());
        let textures = &level.textures;
        let encode = |image: &Option<RgbImage>, format| {
            context.check(&model.name)?;
            image.as_ref().map(|image| encode(model, image, image.dimensions(), format)).transpose()
        };
        // Blocks of JPEG, which are not seen in colours, would show in the light.
        let data = |image| encode(image, TextureFormat::Png);
        let ((base_color, normal), (packed, emissive)) = rayon::join(
            || {
                let base_color = || encode_base_color(model, textures, level.material.alpha_mode);
                rayon::join(base_color, || data(&textures.normal))
            },
            || {
                let emissive = || encode(&textures.emissive, textures.format);
                rayon::join(|| data(&textures.occlusion_roughness_metallic), emissive)
            },
        );
        Ok(Self {
            vertices: vertices.reordered(&order),
            targets,
            triangles,
            material: level.material.clone(),
            base_color: base_color?,
            normal: normal?,
            occlusion_roughness_metallic: packed?,
            emissive: emissive?,
        })
    }

    /// Whether it has morph targets.
    pub(super) fn morphs(&self) -> bool {
        !self.targets.is_empty()
    }

    /// Whether its vertices hang on joints.
    pub(super) fn is_skinned(&self) -> bool {
        !self.vertices.influences.is_empty()
    }

    /// Appends textures, material and mesh; returns the mesh.
    pub(super) fn write(&self, out: &mut Builder, name: &str, sampler: usize) -> usize {
        let material = self.write_material(out, name, sampler);
        let attributes = self.vertices.write(out);
        let vertices = self.vertices.positions.len();
        let indices = if vertices <= MAX_SHORT_INDEXED {
            let short: Vec<u16> = self.triangles.iter().flatten().map(|&i| i as u16).collect();
            out.push_accessor(&short, Component::U16, "SCALAR", Target::Indices)
        } else {
            out.push_accessor(self.triangles.as_flattened(), Component::U32, "SCALAR", Target::Indices)
        };
        let mut primitive = json!({ "attributes": attributes, "indices": indices, "material": material });
        let mut mesh = json!({ "name": name });
        if !self.targets.is_empty() {
            primitive["targets"] = self.vertices.write_morphs(out);
            mesh["weights"] = self.targets.iter().map(|(_, weight)| number(*weight)).collect();
            mesh["extras"] = json!({ "targetNames": self.targets.iter().map(|(name, _)| name).collect::<Vec<_>>() });
        }
        mesh["primitives"] = json!([primitive]);
        out.push(Kind::Mesh, mesh)
    }

    fn write_material(&self, out: &mut Builder, name: &str, sampler: usize) -> usize {
        let mut texture = |image: &EncodedImage| {
            let view = out.push_view(&image.bytes, Target::None);
            let image = out.push(Kind::Image, json!({ "bufferView": view, "mimeType": image.mime }));
            out.push(Kind::Texture, json!({ "source": image, "sampler": sampler }))
        };
        let base_color = texture(&self.base_color);
        let [normal, packed, emissive] =
            [&self.normal, &self.occlusion_roughness_metallic, &self.emissive].map(|t| t.as_ref().map(&mut texture));
        let source = &self.material;
        let (metallic, roughness) = if packed.is_some() { (1.0, 1.0) } else { (source.metallic, source.roughness) };
        let mut material = json!({
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": base_color },
                "metallicFactor": number(metallic),
                "roughnessFactor": number(roughness),
            },
        });
        if let Some(index) = packed {
            material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({ "index": index });
            material["occlusionTexture"] = json!({ "index": index });
        }
        if let Some(index) = normal {
            material["normalTexture"] = json!({ "index": index });
        }
        if source.double_sided {
            material["doubleSided"] = json!(true);
        }
        match source.alpha_mode {
            AlphaMode::Opaque => {}
            AlphaMode::Mask { cutoff } => {
                material["alphaMode"] = json!("MASK");
                material["alphaCutoff"] = number(cutoff);
            }
            AlphaMode::Blend => material["alphaMode"] = json!("BLEND"),
        }
        let mut extensions = Map::new();
        if source.unlit {
            extensions.insert("KHR_materials_unlit".into(), json!({}));
        }
        let strongest = source.emissive.max_element();
        if strongest > 0.0 {
            // Factors end at one: what is above becomes the strength.
            let strength = strongest.max(1.0);
            material["emissiveFactor"] = (source.emissive / strength).to_array().map(number).into_iter().collect();
            if strength > 1.0 {
                let strength = json!({ "emissiveStrength": number(strength) });
                extensions.insert("KHR_materials_emissive_strength".into(), strength);
            }
            if let Some(index) = emissive {
                material["emissiveTexture"] = json!({ "index": index });
            }
        }
        if !extensions.is_empty() {
            extensions.keys().for_each(|name| out.use_extension(name));
            material["extensions"] = Value::Object(extensions);
        }
        out.push(Kind::Material, material)
    }
}

impl Vertices {
    /// The vertices `order` names, in its order.
    fn reordered(&self, order: &[u32]) -> Self {
        fn take<T: Copy>(all: &[T], order: &[u32]) -> Vec<T> {
            if all.is_empty() { Vec::new() } else { order.iter().map(|&v| all[v as usize]).collect() }
        }
        Self {
            positions: take(&self.positions, order),
            normals: take(&self.normals, order),
            tangents: take(&self.tangents, order),
            uvs: take(&self.uvs, order),
            influences: take(&self.influences, order),
            morphs: self
                .morphs
                .iter()
                .map(|m| LevelMorph { positions: take(&m.positions, order), normals: take(&m.normals, order) })
                .collect(),
        }
    }

    /// Takes what the default weights of the morph targets have done back from the vertices.
    fn take_back(&mut self, weights: impl Iterator<Item = f32>) {
        for (morph, weight) in self.morphs.iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
            self.positions.iter_mut().zip(&morph.positions).for_each(|(p, offset)| *p -= *offset * weight);
            self.normals.iter_mut().zip(&morph.normals).for_each(|(n, offset)| *n -= *offset * weight);
        }
        if !self.morphs.is_empty() {
            self.normals.iter_mut().for_each(|n| *n = n.normalize_or(Vec3::Y));
        }
    }

    fn write_morphs(&self, out: &mut Builder) -> Value {
        let mut target = |morph: &LevelMorph| {
            json!({
                "POSITION": write_positions(out, &morph.positions),
                "NORMAL": out.push_accessor(&morph.normals, Component::F32, "VEC3", Target::Vertices),
            })
        };
        self.morphs.iter().map(&mut target).collect()
    }

    fn write(&self, out: &mut Builder) -> Value {
        let mut attributes = Map::new();
        let mut add = |name: &str, accessor: usize| attributes.insert(name.into(), json!(accessor));
        add("POSITION", write_positions(out, &self.positions));
        add("NORMAL", out.push_accessor(&self.normals, Component::F32, "VEC3", Target::Vertices));
        if !self.tangents.is_empty() {
            add("TANGENT", out.push_accessor(&self.tangents, Component::F32, "VEC4", Target::Vertices));
        }
        add("TEXCOORD_0", out.push_accessor(&self.uvs, Component::F32, "VEC2", Target::Vertices));
        if !self.influences.is_empty() {
            add("JOINTS_0", self.write_joints(out));
            let weights: Vec<[f32; 4]> = self.influences.iter().map(|i| i.weights).collect();
            add("WEIGHTS_0", out.push_accessor(&weights, Component::F32, "VEC4", Target::Vertices));
        }
        Value::Object(attributes)
    }

    /// In bytes where they fit, else in shorts.
    fn write_joints(&self, out: &mut Builder) -> usize {
        let bytes: Result<Vec<[u8; 4]>, _> = self.influences.iter().map(|i| bytes_of(i.joints)).collect();
        match bytes {
            Ok(bytes) => out.push_accessor(&bytes, Component::U8, "VEC4", Target::Vertices),
            Err(_) => {
                let shorts: Vec<[u16; 4]> = self.influences.iter().map(|i| i.joints).collect();
                out.push_accessor(&shorts, Component::U16, "VEC4", Target::Vertices)
            }
        }
    }
}

/// With the bounds that glTF asks of positions.
fn write_positions(out: &mut Builder, positions: &[Vec3]) -> usize {
    let accessor = out.push_accessor(positions, Component::F32, "VEC3", Target::Vertices);
    let (low, high) = crate::data::bounds(positions);
    let bounds = &mut out.all_mut(Kind::Accessor)[accessor];
    bounds["min"] = json!(low.to_array());
    bounds["max"] = json!(high.to_array());
    accessor
}

fn bytes_of(joints: [u16; 4]) -> Result<[u8; 4], std::num::TryFromIntError> {
    let mut out = [0; 4];
    for (byte, joint) in out.iter_mut().zip(joints) {
        *byte = u8::try_from(joint)?;
    }
    Ok(out)
}

/// The sampler of all level textures: trilinear, clamped.
pub(super) fn push_sampler(out: &mut Builder) -> usize {
    out.push(Kind::Sampler, json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }))
}

/// Without the alpha channel where nothing shows it.
pub(super) fn encode_base_color(
    model: &Model,
    textures: &LevelTextures,
    alpha_mode: AlphaMode,
) -> Result<EncodedImage, Error> {
    let image = &textures.base_color;
    if alpha_mode == AlphaMode::Opaque || image.pixels().all(|p| p.0[3] == 255) {
        let rgb: Vec<u8> = image.pixels().flat_map(|p| [p.0[0], p.0[1], p.0[2]]).collect();
        encode(model, &rgb, image.dimensions(), textures.format)
    } else {
        png(model, image, image.dimensions(), ExtendedColorType::Rgba8)
    }
}

/// RGB texels.
fn encode(model: &Model, texels: &[u8], size: (u32, u32), format: TextureFormat) -> Result<EncodedImage, Error> {
    match format {
        TextureFormat::Png => png(model, texels, size, ExtendedColorType::Rgb8),
        TextureFormat::Jpeg(quality) => {
            let mut bytes = Vec::new();
            JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100) as u8)
                .write_image(texels, size.0, size.1, ExtendedColorType::Rgb8)
                .map_err(|e| unencodable(model, size, &e))?;
            Ok(EncodedImage { bytes, mime: "image/jpeg" })
        }
    }
}

fn png(model: &Model, texels: &[u8], size: (u32, u32), color: ExtendedColorType) -> Result<EncodedImage, Error> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Level(PNG_LEVEL), FilterType::Adaptive)
        .write_image(texels, size.0, size.1, color)
        .map_err(|e| unencodable(model, size, &e))?;
    Ok(EncodedImage { bytes, mime: "image/png" })
}

fn unencodable(model: &Model, (width, height): (u32, u32), error: &ImageError) -> Error {
    fault(&model.name, format!("a texture of {width}x{height} texels cannot be encoded: {error}"))
}

/// Checks the arrays of a level against each other.
fn check(model: &Model, level: &Level) -> Result<(), Error> {
    let mesh = &level.mesh;
    let n = mesh.positions.len();
    let bad = |found: String| Err(fault(&model.name, format!("the level of {} faces {found}", level.budget)));
    if mesh.triangles.is_empty() {
        return bad("has no triangles".into());
    }
    for (what, len, may_be_empty) in [
        ("normals", mesh.normals.len(), false),
        ("texture coordinates", mesh.uvs.len(), false),
        ("tangents", mesh.tangents.len(), true),
        ("influences", mesh.influences.len(), true),
        ("moves of a morph target", mesh.morphs.iter().map(|m| m.positions.len()).max().unwrap_or(0), true),
        ("normals of a morph target", mesh.morphs.iter().map(|m| m.normals.len()).min().unwrap_or(0), true),
    ] {
        if len != n && !(may_be_empty && len == 0) {
            return bad(format!("has {len} {what} for {n} vertices"));
        }
    }
    if let Some(v) = mesh.triangles.iter().flatten().find(|&&v| v as usize >= n) {
        return bad(format!("refers to vertex {v} of {n}"));
    }
    let finite = mesh.positions.iter().all(|p| p.is_finite())
        && mesh.normals.iter().all(|p| p.is_finite())
        && mesh.tangents.iter().all(|p| p.is_finite())
        && mesh.uvs.iter().all(|p| p.is_finite());
    if !finite {
        return bad("has vertices that are not finite".into());
    }
    check_influences(model, level)
}
