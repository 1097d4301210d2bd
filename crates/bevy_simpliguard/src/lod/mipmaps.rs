//! Textures of levels and of their source: with mipmaps, and from blocks where a file has them.
//!
//! Textures of glTF files have no mipmaps, and Bevy makes none. Without mipmaps, a distant model sparkles, and levels are
//! seen from a distance. A source without mipmaps beside a level that has some would change its look at each switch.
//!
//! The images are made while the file is loaded, in parallel to the game, and replace those of the loader. Blocks go to the
//! GPU as they are, with their mipmaps. Where it takes none, or where there is no GPU, they are decoded.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::asset::RenderAssetUsages;
use bevy::gltf::{GltfAssetLabel, GltfLoaderSettings};
use bevy::image::{
    CompressedImageFormats, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor, ImageType,
};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task};
use gltf::image::Source;
use gltf::material::AlphaMode;
use gltf::texture::{MagFilter, MinFilter, WrappingMode};
use simpliguard_texture::{Content, mip_chain, mipmap_count};

use super::blocks::{Blocks, Use};

/// Makes the images of a file. Bevy clones it for each file.
#[derive(Clone)]
pub(super) struct Mipmaps {
    options: TextureOptions,
    default_sampler: Arc<Mutex<ImageSamplerDescriptor>>,
    sampler: ImageSamplerDescriptor,
    /// True if the sampler replaces that of each texture.
    overrides: bool,
    usages: RenderAssetUsages,
    /// The name of the file.
    name: String,
    /// True if the file has levels, so that its textures are to have mipmaps.
    has_levels: bool,
    /// The images of the file that lie in blocks.
    blocks: HashMap<usize, Blocks>,
    /// Textures whose images are done or on the way.
    begun: HashSet<usize>,
}

/// The textures that a game wants.
#[derive(Clone, Copy)]
pub(super) struct TextureOptions {
    /// True if they have mipmaps.
    pub(super) mipmaps: bool,
    /// Anisotropy of textures whose sampler has none.
    pub(super) anisotropy: u16,
    /// The formats that the GPU takes.
    pub(super) formats: CompressedImageFormats,
}

impl Mipmaps {
    /// `default_sampler` is the default of Bevy's loader.
    pub(super) fn new(default_sampler: Arc<Mutex<ImageSamplerDescriptor>>, options: TextureOptions) -> Self {
        Self {
            options: TextureOptions { anisotropy: options.anisotropy.max(1), ..options },
            default_sampler,
            sampler: ImageSamplerDescriptor::default(),
            overrides: false,
            usages: RenderAssetUsages::default(),
            name: String::new(),
            has_levels: false,
            blocks: HashMap::default(),
            begun: HashSet::default(),
        }
    }

    /// Begins a file.
    pub(super) fn begin(
        &mut self,
        document: &gltf::Document,
        name: &str,
        settings: &GltfLoaderSettings,
        has_levels: bool,
    ) {
        let default = || self.default_sampler.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.sampler = settings.default_sampler.clone().unwrap_or_else(default);
        self.overrides = settings.override_sampler;
        self.usages = settings.load_materials;
        self.has_levels = has_levels;
        name.clone_into(&mut self.name);
        let in_blocks = |image: gltf::Image<'_>| Some((image.index(), Blocks::of(document, &image)?));
        self.blocks = document.images().filter_map(in_blocks).collect();
        if settings.load_meshes.is_empty() && !self.blocks.is_empty() {
            warn!("{name}: its textures look blurred, because they are made with its meshes, which are not loaded");
        }
    }

    /// Starts to make the images of a material. Returns the label of each texture, and the task that makes its image.
    pub(super) fn start(
        &mut self,
        material: &gltf::Material<'_>,
        buffers: &[Vec<u8>],
    ) -> Vec<(GltfAssetLabel, Task<Option<Image>>)> {
        if self.usages.is_empty() {
            return Vec::new();
        }
        let new = textures(material).into_iter().filter(|(texture, _)| self.begun.insert(texture.index()));
        let new: Vec<_> = new.collect();
        let task = |(texture, content): (gltf::Texture<'_>, Content)| {
            let task = match self.blocks.get(&texture.source().index()) {
                Some(blocks) => self.unpack(blocks, &texture, buffers),
                None if self.has_levels => self.add_mipmaps(&texture, content, buffers),
                None => None,
            };
            Some((GltfAssetLabel::Texture(texture.index()), task?))
        };
        new.into_iter().filter_map(task).collect()
    }

    /// The image of a texture in blocks.
    fn unpack(&self, blocks: &Blocks, texture: &gltf::Texture<'_>, buffers: &[Vec<u8>]) -> Option<Task<Option<Image>>> {
        let (blocks, bytes) = (blocks.clone(), blocks.bytes(buffers)?);
        let with_mipmaps = self.sampler_of(&texture.sampler());
        let mipmaps = with_mipmaps.is_some();
        let sampler = with_mipmaps.unwrap_or_else(|| self.sampler_without_mipmaps(&texture.sampler()));
        let (name, usages, formats) = (self.name.clone(), self.usages, self.options.formats);
        let used = Use { name, sampler, mipmaps, usages, formats };
        Some(AsyncComputeTaskPool::get().spawn(async move { blocks.image(&bytes, used) }))
    }

    /// The image of a texture with mipmaps. `None` if it is to have none.
    fn add_mipmaps(
        &self,
        texture: &gltf::Texture<'_>,
        content: Content,
        buffers: &[Vec<u8>],
    ) -> Option<Task<Option<Image>>> {
        let Source::View { view, mime_type } = texture.source().source() else { return None };
        let bytes = buffers.get(view.buffer().index())?.get(view.offset()..view.offset() + view.length())?.to_vec();
        let sampler = ImageSampler::Descriptor(self.sampler_of(&texture.sampler())?);
        let (mime_type, usages) = (mime_type.to_owned(), self.usages);
        let image = async move {
            let (format, none) = (ImageType::MimeType(&mime_type), CompressedImageFormats::NONE);
            let image = Image::from_buffer(&bytes, format, none, content.is_colour(), sampler, usages).ok()?;
            with_mipmaps(image, content)
        };
        Some(AsyncComputeTaskPool::get().spawn(image))
    }

    /// The sampler of a texture with mipmaps: that of Bevy's loader, and anisotropic. `None` if the game wants no mipmaps,
    /// or if the texture's own sampler asks for none.
    fn sampler_of(&self, sampler: &gltf::texture::Sampler<'_>) -> Option<ImageSamplerDescriptor> {
        if !self.options.mipmaps {
            return None;
        }
        if self.overrides {
            return Some(self.sampler.clone());
        }
        let mut out = self.wrapped(sampler);
        // Textures that say nothing look as the game's default wants; pixel art stays what it is.
        let is_smooth = match sampler.min_filter() {
            Some(filter) => filter == MinFilter::LinearMipmapLinear,
            None => out.min_filter == ImageFilterMode::Linear,
        };
        let is_smooth = is_smooth && sampler.mag_filter() != Some(MagFilter::Nearest);
        // Anisotropic filters are trilinear. A game's own anisotropy stays.
        if out.anisotropy_clamp == 1 {
            out.set_anisotropic_filter(self.options.anisotropy);
        }
        is_smooth.then_some(out)
    }

    /// The sampler that Bevy's loader gives a texture in blocks, which is no pixel art.
    fn sampler_without_mipmaps(&self, sampler: &gltf::texture::Sampler<'_>) -> ImageSamplerDescriptor {
        if self.overrides {
            return self.sampler.clone();
        }
        let mut out = self.wrapped(sampler);
        // Filters of glTF are not read where the game's own are anisotropic.
        if out.anisotropy_clamp == 1 {
            if sampler.mag_filter() == Some(MagFilter::Linear) {
                out.mag_filter = ImageFilterMode::Linear;
            }
            if sampler.min_filter() == Some(MinFilter::LinearMipmapLinear) {
                (out.min_filter, out.mipmap_filter) = (ImageFilterMode::Linear, ImageFilterMode::Linear);
            }
        }
        out
    }

    /// The game's sampler, with the wrap modes of a texture.
    fn wrapped(&self, sampler: &gltf::texture::Sampler<'_>) -> ImageSamplerDescriptor {
        let mode = |mode| match mode {
            WrappingMode::ClampToEdge => ImageAddressMode::ClampToEdge,
            WrappingMode::MirroredRepeat => ImageAddressMode::MirrorRepeat,
            WrappingMode::Repeat => ImageAddressMode::Repeat,
        };
        let mut out = self.sampler.clone();
        (out.address_mode_u, out.address_mode_v) = (mode(sampler.wrap_s()), mode(sampler.wrap_t()));
        out
    }
}

/// The textures of a material.
pub(super) fn textures<'a>(material: &gltf::Material<'a>) -> Vec<(gltf::Texture<'a>, Content)> {
    let colour = match material.alpha_mode() {
        AlphaMode::Mask => Content::CutOut(material.alpha_cutoff().unwrap_or(0.5)),
        AlphaMode::Opaque | AlphaMode::Blend => Content::Colour,
    };
    let pbr = material.pbr_metallic_roughness();
    let all = [
        (pbr.base_color_texture().map(|info| info.texture()), colour),
        (material.emissive_texture().map(|info| info.texture()), Content::Colour),
        (material.normal_texture().map(|normal| normal.texture()), Content::Normals),
        (pbr.metallic_roughness_texture().map(|info| info.texture()), Content::Data),
        (material.occlusion_texture().map(|occlusion| occlusion.texture()), Content::Data),
    ];
    all.into_iter().filter_map(|(texture, content)| Some((texture?, content))).collect()
}

/// The image with all its mipmaps. `None` if it already has some, or does not have four bytes a texel.
fn with_mipmaps(mut image: Image, content: Content) -> Option<Image> {
    if image.texture_descriptor.mip_level_count > 1 {
        return None;
    }
    let size = image.size();
    image.data = Some(mip_chain(image.data.take()?, size, content)?.texels);
    image.texture_descriptor.mip_level_count = mipmap_count(size);
    Some(image)
}

#[cfg(test)]
mod tests {
    use bevy::image::TextureFormatPixelInfo;

    use super::*;

    #[test]
    fn an_image_gets_mipmaps_once() {
        let mut image = Image::default();
        (image.texture_descriptor.size.width, image.texture_descriptor.size.height) = (8, 2);
        image.data = Some(vec![200; 4 * 16]);
        assert_eq!(image.texture_descriptor.format.pixel_size().ok(), Some(4));
        let image = with_mipmaps(image, Content::Colour).expect("four bytes a texel");
        assert_eq!(image.texture_descriptor.mip_level_count, 4);
        assert_eq!(image.data, Some(vec![200; 4 * (16 + 4 + 2 + 1)]));
        assert!(with_mipmaps(image, Content::Colour).is_none());
        let of_three_bytes = Image { data: Some(vec![200; 3]), ..default() };
        assert!(with_mipmaps(of_three_bytes, Content::Colour).is_none());
    }
}
