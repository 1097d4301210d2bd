//! Memory on the GPU of the models with levels, from the assets that are loaded.

use std::ops::AddAssign;

use bevy::asset::RenderAssetUsages;
use bevy::platform::collections::HashSet;
use bevy::prelude::*;

use super::components::{LodGroup, LodLevel};

/// Memory of one model. All its instances share it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ModelMemory {
    /// Path of the model's file. Empty if its meshes come from no file.
    pub path: String,
    /// Memory of the source; zero if the file was baked without it.
    pub source: Memory,
    /// Memory of all levels.
    pub levels: Memory,
}

/// Bytes on the GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Bytes of textures, with their mipmaps.
    pub textures: u64,
    /// Bytes of vertices and indices.
    pub meshes: u64,
}

impl Memory {
    /// Bytes of textures and meshes.
    pub fn total(self) -> u64 {
        self.textures + self.meshes
    }
}

impl AddAssign for Memory {
    fn add_assign(&mut self, other: Self) {
        self.textures += other.textures;
        self.meshes += other.meshes;
    }
}

/// The memory of each model of these groups, the largest first. Assets that are not loaded yet, and meshes that only the
/// renderer has, count nothing.
pub fn memory_of<'a>(
    groups: impl IntoIterator<Item = &'a LodGroup>,
    meshes: &Assets<Mesh>,
    images: &Assets<Image>,
) -> Vec<ModelMemory> {
    let mut seen = HashSet::new();
    let is_new = |group: &&LodGroup| first_mesh(group).is_some_and(|mesh| seen.insert(mesh.id()));
    let mut models: Vec<_> = groups.into_iter().filter(is_new).map(|group| model(group, meshes, images)).collect();
    models.sort_by_key(|model| std::cmp::Reverse(model.source.total() + model.levels.total()));
    models
}

fn first_mesh(group: &LodGroup) -> Option<&Handle<Mesh>> {
    group.levels.iter().flat_map(|level| &level.primitives).map(|primitive| &primitive.mesh).next()
}

fn model(group: &LodGroup, meshes: &Assets<Mesh>, images: &Assets<Image>) -> ModelMemory {
    let path = first_mesh(group).and_then(Handle::path).map(|path| path.clone().without_label().to_string());
    let mut model = ModelMemory { path: path.unwrap_or_default(), ..default() };
    let mut counted = (HashSet::new(), HashSet::new());
    for level in &group.levels {
        let memory = if level.level == 0 { &mut model.source } else { &mut model.levels };
        *memory += memory_of_level(level, (meshes, images), &mut counted);
    }
    model
}

/// Memory of what the levels before do not have.
fn memory_of_level(
    level: &LodLevel,
    (meshes, images): (&Assets<Mesh>, &Assets<Image>),
    counted: &mut (HashSet<AssetId<Mesh>>, HashSet<AssetId<Image>>),
) -> Memory {
    let new = level.primitives.iter().map(|primitive| primitive.mesh.id()).filter(|mesh| counted.0.insert(*mesh));
    let mesh_bytes = new.filter_map(|mesh| meshes.get(mesh)).map(bytes_of_mesh).sum();
    let new = level.textures.iter().map(Handle::id).filter(|image| counted.1.insert(*image));
    let texture_bytes = new.filter_map(|image| images.get(image)).map(bytes_of_image).sum();
    Memory { textures: texture_bytes, meshes: mesh_bytes }
}

/// Bytes of vertices and indices. Zero if only the renderer has them.
pub(super) fn bytes_of_mesh(mesh: &Mesh) -> u64 {
    if !mesh.asset_usage.contains(RenderAssetUsages::MAIN_WORLD) {
        return 0;
    }
    (mesh.get_vertex_buffer_size() + mesh.get_index_buffer_bytes().map_or(0, <[u8]>::len)) as u64
}

/// Bytes of an image with its mipmaps.
pub(super) fn bytes_of_image(image: &Image) -> u64 {
    let descriptor = &image.texture_descriptor;
    let (width, height) = descriptor.format.block_dimensions();
    let bytes = u64::from(descriptor.format.block_copy_size(None).unwrap_or(0));
    let blocks = |level: u32, side: u32, block: u32| u64::from((side >> level).max(1).div_ceil(block));
    let size = descriptor.size;
    let of_level = |level| blocks(level, size.width, width) * blocks(level, size.height, height) * bytes;
    (0..descriptor.mip_level_count).map(of_level).sum::<u64>() * u64::from(size.depth_or_array_layers)
}

#[cfg(test)]
mod tests {
    use wgpu_types::TextureFormat;

    use super::*;
    use crate::lod::LodPrimitive;

    fn image(side: u32, format: TextureFormat, mipmaps: u32) -> Image {
        let mut image = Image::default();
        (image.texture_descriptor.size.width, image.texture_descriptor.size.height) = (side, side);
        (image.texture_descriptor.format, image.texture_descriptor.mip_level_count) = (format, mipmaps);
        image
    }

    #[test]
    fn images_count_their_mipmaps_and_blocks() {
        assert_eq!(bytes_of_image(&image(4, TextureFormat::Rgba8Unorm, 1)), 64);
        assert_eq!(bytes_of_image(&image(4, TextureFormat::Rgba8Unorm, 3)), 64 + 16 + 4);
        assert_eq!(bytes_of_image(&image(8, TextureFormat::Bc7RgbaUnorm, 4)), 64 + 16 + 16 + 16);
    }

    #[test]
    fn what_instances_and_levels_share_counts_once() {
        let (mut meshes, mut images) = (Assets::<Mesh>::default(), Assets::<Image>::default());
        let [large, small] = [300.0, 1.0].map(|size| meshes.add(Cuboid::from_length(size)));
        let texture = images.add(image(2, TextureFormat::Rgba8Unorm, 1));
        let level = |level, mesh: &Handle<Mesh>, textures| LodLevel {
            level,
            budget: 12,
            faces: 12,
            error: 0.0,
            primitives: vec![LodPrimitive { entity: Entity::PLACEHOLDER, mesh: mesh.clone(), faces: 12 }],
            textures,
        };
        let levels =
            vec![level(0, &large, vec![texture.clone(); 2]), level(2, &small, vec![texture]), level(1, &small, vec![])];
        let group = LodGroup { object: String::new(), center: Vec3::ZERO, radius: 1.0, levels, objects: Vec::new() };
        let mesh = bytes_of_mesh(meshes.get(&small).expect("a mesh"));
        assert!(mesh > 24 * 32);
        let expected = ModelMemory {
            path: String::new(),
            source: Memory { textures: 16, meshes: mesh },
            levels: Memory { textures: 0, meshes: mesh },
        };
        assert_eq!(memory_of([&group, &group], &meshes, &images), [expected]);
    }
}
