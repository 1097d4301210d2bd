//! The shared textures, composed of tiles.

use glam::{Vec3, Vec4};
use image::{DynamicImage, RgbImage, Rgba, RgbaImage};
use rayon::prelude::*;

use super::pack::{Layout, Place};
use super::tile::{Map, Tile};
use crate::data::{
    AlphaMode, LevelMaterial, LevelTextures, Texture, TextureFormat, Wrap, linear_to_srgb, srgb_to_linear, to_byte,
};
use crate::gltf::export::fault::fault;
use crate::{Cancellation, Error};

/// The shared textures, and the material that shows them.
pub(super) struct Composed {
    pub(super) textures: LevelTextures,
    /// The modes are those of any tile.
    pub(super) material: LevelMaterial,
}

/// Composes the textures of all tiles. A map that is the same everywhere becomes a factor.
pub(super) fn compose(
    asset: &str,
    tiles: &[Tile],
    layout: &Layout,
    format: TextureFormat,
    cancellation: &Cancellation,
) -> Result<Composed, Error> {
    let strongest = tiles.iter().map(|tile| tile.emissive.max_element()).fold(0.0, f32::max);
    let atlas = Atlas { asset, tiles, layout, strongest, cancellation };
    let [base_color, normal, packed, emissive] =
        [Map::BaseColor, Map::Normal, Map::OcclusionRoughnessMetallic, Map::Emissive].map(|map| atlas.compose(map));
    let (base_color, emissive) = (base_color?, emissive?.map(without_alpha));
    let first = &tiles[0];
    let material = LevelMaterial {
        alpha_mode: AlphaMode::Opaque,
        double_sided: false,
        unlit: false,
        base_color: if base_color.is_some() { Vec4::ONE } else { first.base_color },
        metallic: first.metallic,
        roughness: first.roughness,
        emissive: if emissive.is_some() { Vec3::splat(strongest) } else { first.emissive },
        transmission: None,
    };
    let textures = LevelTextures {
        base_color,
        normal: normal?.map(without_alpha),
        occlusion_roughness_metallic: packed?.map(without_alpha),
        emissive,
        format,
    };
    Ok(Composed { textures, material })
}

struct Atlas<'a> {
    asset: &'a str,
    tiles: &'a [Tile],
    layout: &'a Layout,
    /// The strongest emission, in linear light.
    strongest: f32,
    cancellation: &'a Cancellation,
}

impl Atlas<'_> {
    /// One texture of all tiles; `None` if it would have one colour.
    fn compose(&self, map: Map) -> Result<Option<RgbaImage>, Error> {
        let plain = |tile: &Tile| tile.image(map).is_none().then(|| self.texel(map, tile, map.neutral()));
        let first = plain(&self.tiles[0]);
        if first.is_some() && self.tiles.iter().all(|tile| plain(tile) == first) {
            return Ok(None);
        }
        let tiles = self.tiles.par_iter().zip(&self.layout.places);
        let painted: Vec<RgbaImage> =
            tiles.map(|(tile, place)| self.paint(map, tile, *place)).collect::<Result<_, Error>>()?;
        let side = self.layout.side;
        let mut out = RgbaImage::from_pixel(side, side, Rgba(map.neutral()));
        for (image, place) in painted.iter().zip(&self.layout.places) {
            let [x, y] = place.corner.map(i64::from);
            image::imageops::replace(&mut out, image, x, y);
        }
        Ok(Some(out))
    }

    /// A tile at the size of its place.
    fn paint(&self, map: Map, tile: &Tile, place: Place) -> Result<RgbaImage, Error> {
        self.cancellation.check(self.asset)?;
        let Some(bytes) = tile.image(map) else {
            return Ok(RgbaImage::from_pixel(place.side, place.side, Rgba(self.texel(map, tile, map.neutral()))));
        };
        let image = image::load_from_memory(bytes)
            .map_err(|error| fault(self.asset, format!("a texture of a level cannot be read: {error}")))?;
        let mut image = Texture::new(&image.into_rgba8(), [Wrap::Clamp; 2], map.is_srgb()).mip_of(place.side);
        image.pixels_mut().for_each(|pixel| pixel.0 = self.texel(map, tile, pixel.0));
        // Maps of one tile may differ in size.
        let is_small = image.width() < place.side;
        Ok(if is_small { image::imageops::resize(&image, place.side, place.side, FILTER) } else { image })
    }

    /// A texel with the factors of its material.
    fn texel(&self, map: Map, tile: &Tile, [r, g, b, a]: [u8; 4]) -> [u8; 4] {
        let factors = match map {
            Map::BaseColor => tile.base_color,
            Map::Normal => Vec4::ONE,
            Map::OcclusionRoughnessMetallic => Vec4::new(1.0, tile.roughness, tile.metallic, 1.0),
            Map::Emissive => (tile.emissive / self.strongest.max(f32::MIN_POSITIVE)).extend(1.0),
        };
        let scale = |byte: u8, factor: f32| match (factor == 1.0, map.is_srgb()) {
            (true, _) => byte,
            (false, true) => to_byte(linear_to_srgb(srgb_to_linear(f32::from(byte) / 255.0) * factor)),
            (false, false) => to_byte(f32::from(byte) / 255.0 * factor),
        };
        [scale(r, factors.x), scale(g, factors.y), scale(b, factors.z), to_byte(f32::from(a) / 255.0 * factors.w)]
    }
}

/// Repeats texels: a map that is smaller than its tile gains no detail.
const FILTER: image::imageops::FilterType = image::imageops::FilterType::Nearest;

impl Map {
    /// The texel of a tile without this map, before factors.
    fn neutral(self) -> [u8; 4] {
        if self == Self::Normal { [128, 128, 255, 255] } else { [255; 4] }
    }

    fn is_srgb(self) -> bool {
        matches!(self, Self::BaseColor | Self::Emissive)
    }
}

fn without_alpha(image: RgbaImage) -> RgbImage {
    DynamicImage::from(image).into_rgb8()
}
