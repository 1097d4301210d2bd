//! Textures in blocks of BC7, which processed files have in place of PNG and JPEG.

use std::ops::Range;

use bevy::asset::RenderAssetUsages;
use bevy::image::{CompressedImageFormats, ImageSampler, ImageSamplerDescriptor};
use bevy::log::warn;
use bevy::prelude::Image;
use gltf::json::deserialize;
use simpliguard_texture::{BlockTexture, ImageExtras};
use wgpu_types::{Extent3d, TextureDimension, TextureFormat};

/// The place of a texture in blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Blocks {
    texture: BlockTexture,
    buffer: usize,
    range: Range<usize>,
}

/// The use of a texture in a game.
#[derive(Clone)]
pub(super) struct Use {
    /// The name of the file, for messages.
    pub(super) name: String,
    pub(super) sampler: ImageSamplerDescriptor,
    /// True if it is sampled with mipmaps.
    pub(super) mipmaps: bool,
    pub(super) usages: RenderAssetUsages,
    /// The formats that the GPU takes.
    pub(super) formats: CompressedImageFormats,
}

impl Blocks {
    /// The blocks of an image. `None` if it has none.
    pub(super) fn of(document: &gltf::Document, image: &gltf::Image<'_>) -> Option<Self> {
        let texture = deserialize::from_str::<ImageExtras>(image.extras().as_ref()?.get()).ok()?.simpliguard.bc7;
        let view = document.views().nth(texture.buffer_view)?;
        let range = view.offset()..view.offset().checked_add(view.length())?;
        Some(Self { texture, buffer: view.buffer().index(), range })
    }

    /// The bytes in the file.
    pub(super) fn bytes(&self, buffers: &[Vec<u8>]) -> Option<Vec<u8>> {
        Some(buffers.get(self.buffer)?.get(self.range.clone())?.to_vec())
    }

    /// The image as the GPU takes it: in blocks, or else as texels. `None`, with a warning, if the bytes are damaged.
    pub(super) fn image(&self, deflated: &[u8], used: Use) -> Option<Image> {
        let Use { name, sampler, mipmaps, usages, formats } = used;
        let texture = &self.texture;
        let Some(mut blocks) = texture.inflate(deflated) else {
            warn!("{name}: a texture is damaged and looks blurred; bake the model again");
            return None;
        };
        let mipmaps = if mipmaps { texture.mipmap_count() } else { 1 };
        let (data, format) = if formats.contains(CompressedImageFormats::BC) {
            blocks.truncate(texture.byte_len(mipmaps));
            (blocks, [TextureFormat::Bc7RgbaUnorm, TextureFormat::Bc7RgbaUnormSrgb])
        } else {
            (texture.decode(&blocks, mipmaps), [TextureFormat::Rgba8Unorm, TextureFormat::Rgba8UnormSrgb])
        };
        let size = Extent3d { width: texture.width, height: texture.height, depth_or_array_layers: 1 };
        let format = format[usize::from(texture.srgb)];
        let mut image = Image::new_uninit(size, TextureDimension::D2, format, usages);
        image.data = Some(data);
        image.texture_descriptor.mip_level_count = mipmaps;
        image.sampler = ImageSampler::Descriptor(sampler);
        Some(image)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use simpliguard_texture::Stamp;

    use super::*;

    /// Bytes that are no blocks.
    const DAMAGED: [u8; 9] = [7; 9];

    fn blocks(extras: &serde_json::Value) -> Option<Blocks> {
        let json = json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "byteLength": 90 }],
            "bufferViews": [
                { "buffer": 0, "byteLength": 4 },
                { "buffer": 0, "byteOffset": 4, "byteLength": DAMAGED.len() },
            ],
            "images": [{ "bufferView": 0, "mimeType": "image/png", "extras": extras }],
        });
        let document = gltf::Gltf::from_slice_without_validation(json.to_string().as_bytes()).expect("glTF").document;
        Blocks::of(&document, &document.images().next().expect("an image"))
    }

    fn of_view(buffer_view: usize) -> serde_json::Value {
        json!(ImageExtras { simpliguard: Stamp { bc7: BlockTexture { buffer_view, width: 8, height: 4, srgb: true } } })
    }

    fn use_of(mipmaps: bool, formats: CompressedImageFormats) -> Use {
        let (sampler, usages) = (ImageSamplerDescriptor::default(), RenderAssetUsages::default());
        Use { name: "model.glb".into(), sampler, mipmaps, usages, formats }
    }

    #[test]
    fn extras_of_an_image_name_its_blocks() {
        let found = blocks(&of_view(1)).expect("blocks");
        assert_eq!((found.buffer, found.range.clone()), (0, 4..4 + DAMAGED.len()));
        assert_eq!(found.bytes(&[vec![7; 90]]), Some(vec![7; DAMAGED.len()]));
        assert_eq!(found.bytes(&[vec![7; 9]]), None);
        for other in [of_view(2), json!({}), json!("a text"), json!({ "simpliguard": { "bc7": 3 } })] {
            assert_eq!(blocks(&other), None, "{other}");
        }
    }

    #[test]
    fn damaged_blocks_leave_the_small_image() {
        let found = blocks(&of_view(1)).expect("blocks");
        assert!(found.image(&DAMAGED, use_of(true, CompressedImageFormats::BC)).is_none());
    }

    #[test]
    fn a_gpu_gets_what_it_takes() {
        // A stored block of deflate: 80 zeros.
        let deflated: Vec<u8> = [1, 80, 0, !80, !0].into_iter().chain([0; 80]).collect();
        let found = blocks(&of_view(1)).expect("blocks");
        let image = |mipmaps, formats| found.image(&deflated, use_of(mipmaps, formats)).expect("whole");
        let expected = [
            (true, CompressedImageFormats::BC, TextureFormat::Bc7RgbaUnormSrgb, 4, 80),
            (false, CompressedImageFormats::BC, TextureFormat::Bc7RgbaUnormSrgb, 1, 32),
            (true, CompressedImageFormats::ETC2, TextureFormat::Rgba8UnormSrgb, 4, 4 * (32 + 8 + 2 + 1)),
            (false, CompressedImageFormats::NONE, TextureFormat::Rgba8UnormSrgb, 1, 4 * 32),
        ];
        for (mipmaps, formats, format, count, bytes) in expected {
            let image = image(mipmaps, formats);
            let descriptor = &image.texture_descriptor;
            assert_eq!((descriptor.format, descriptor.mip_level_count), (format, count));
            assert_eq!(image.data.as_ref().map(Vec::len), Some(bytes), "{format:?} with {count} mipmaps");
        }
    }
}
