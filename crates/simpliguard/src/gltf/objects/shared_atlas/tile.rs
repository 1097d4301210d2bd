//! A level's part of the shared textures: its image files and the factors of its material.

use std::io::Cursor;

use glam::{Vec3, Vec4};
use image::ImageReader;
use serde_json::Value;

use crate::data::{AlphaMode, LevelMaterial};
use crate::gltf::export::builder::{Builder, Kind, index};

/// Least side of a tile in texels: of one without textures, and of those that are halved.
pub(super) const LEAST_SIDE: u32 = 4;
/// Largest side of a tile in texels: the largest `texture_size`.
const LARGEST_SIDE: u32 = 4096;

/// The textures that a tile may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Map {
    BaseColor,
    Normal,
    OcclusionRoughnessMetallic,
    Emissive,
}

/// Properties of a material that no texture holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mode {
    alpha_mode: AlphaMode,
    double_sided: bool,
    unlit: bool,
}

/// The look of a level.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    pub(super) mode: Mode,
    /// Linear.
    pub(super) base_color: Vec4,
    pub(super) metallic: f32,
    pub(super) roughness: f32,
    /// Linear light.
    pub(super) emissive: Vec3,
    /// Image files, by [`Map`].
    images: [Option<Vec<u8>>; 4],
    side: u32,
}

impl Tile {
    /// Reads a material. `None` for one that others cannot share: a clear one, one with other extensions than the export gives
    /// to solid layers, and one whose textures are not square.
    pub(super) fn read(from: &Builder, material: usize) -> Option<Self> {
        let material = from.all(Kind::Material).get(material)?;
        let extensions = material.get("extensions").and_then(Value::as_object);
        let known = ["KHR_materials_unlit", "KHR_materials_emissive_strength"];
        if !extensions.into_iter().flatten().all(|(name, _)| known.contains(&name.as_str())) {
            return None;
        }
        let extension = |name: &str| material.get("extensions")?.get(name);
        let reflection = |key: &str| material.get("pbrMetallicRoughness")?.get(key);
        let number = |value: Option<&Value>| value.and_then(Value::as_f64).map_or(1.0, |x| x as f32);
        let base_color = reflection("baseColorFactor").and_then(numbers).map_or(Vec4::ONE, Vec4::from_array);
        let strength = number(extension(known[1]).and_then(|e| e.get("emissiveStrength")));
        let emissive = material.get("emissiveFactor").and_then(numbers).map_or(Vec3::ZERO, Vec3::from_array);
        let packed = reflection("metallicRoughnessTexture");
        let occlusion = material.get("occlusionTexture");
        let is_plain =
            |texture: &Value| index(texture, "texCoord").unwrap_or(0) == 0 && texture.get("extensions").is_none();
        let normal = material.get("normalTexture");
        let textures = [reflection("baseColorTexture"), packed, normal, occlusion, material.get("emissiveTexture")];
        // Materials that a level has kept from its source may have more than a tile.
        if !textures.into_iter().flatten().all(is_plain)
            || occlusion.is_some_and(|occlusion| Some(occlusion) != packed)
            || normal.and_then(|normal| normal.get("scale")).is_some()
        {
            return None;
        }
        let image = |texture: Option<&Value>| texture.map(|texture| image_file(from, texture)).transpose();
        let images = [
            image(reflection("baseColorTexture")).ok()?,
            image(material.get("normalTexture")).ok()?,
            image(packed).ok()?,
            image(material.get("emissiveTexture")).ok()?,
        ];
        Some(Self {
            mode: Mode::read(material, extension(known[0]).is_some())?,
            base_color,
            metallic: number(reflection("metallicFactor")),
            roughness: number(reflection("roughnessFactor")),
            emissive: emissive * strength,
            side: side(&images)?,
            images,
        })
    }

    /// Texels along a side, a power of two.
    pub(super) fn side(&self) -> u32 {
        self.side
    }

    /// The image file of a map.
    pub(super) fn image(&self, map: Map) -> Option<&[u8]> {
        self.images[map as usize].as_deref()
    }
}

impl Mode {
    fn read(material: &Value, unlit: bool) -> Option<Self> {
        let alpha_mode = match material.get("alphaMode").and_then(Value::as_str) {
            None | Some("OPAQUE") => AlphaMode::Opaque,
            Some("MASK") => {
                let cutoff = material.get("alphaCutoff").and_then(Value::as_f64).unwrap_or(0.5) as f32;
                AlphaMode::Mask { cutoff }
            }
            Some(_) => return None,
        };
        let double_sided = material.get("doubleSided").and_then(Value::as_bool).unwrap_or(false);
        Some(Self { alpha_mode, double_sided, unlit })
    }

    /// True if alpha is seen.
    pub(super) fn has_alpha(self) -> bool {
        self.alpha_mode != AlphaMode::Opaque
    }

    /// The shared material in this mode.
    pub(super) fn apply(self, material: &LevelMaterial) -> LevelMaterial {
        let Self { alpha_mode, double_sided, unlit } = self;
        LevelMaterial { alpha_mode, double_sided, unlit, ..material.clone() }
    }
}

/// The file of the image that a texture reference shows. `Err` if it cannot be found.
fn image_file(from: &Builder, texture: &Value) -> Result<Vec<u8>, ()> {
    let view = || {
        let texture = from.all(Kind::Texture).get(index(texture, "index")?)?;
        let image = from.all(Kind::Image).get(index(texture, "source")?)?;
        let view = from.all(Kind::BufferView).get(index(image, "bufferView")?)?;
        let start = index(view, "byteOffset").unwrap_or(0);
        from.bin.get(start..start.checked_add(index(view, "byteLength")?)?)
    };
    view().map(<[u8]>::to_vec).ok_or(())
}

/// The side of a tile with these images. `None` if one of them is not square, too large or of a side that is no power of two.
fn side(images: &[Option<Vec<u8>>; 4]) -> Option<u32> {
    let mut side = LEAST_SIDE;
    for bytes in images.iter().flatten() {
        let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?;
        let (width, height) = reader.into_dimensions().ok()?;
        if width != height || !width.is_power_of_two() || width > LARGEST_SIDE {
            return None;
        }
        side = side.max(width);
    }
    Some(side)
}

/// An array of numbers.
fn numbers<const N: usize>(value: &Value) -> Option<[f32; N]> {
    let all: Vec<f32> = value.as_array()?.iter().filter_map(Value::as_f64).map(|x| x as f32).collect();
    all.try_into().ok()
}
