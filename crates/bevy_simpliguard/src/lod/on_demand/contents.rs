//! Meshes and textures of a source or a level in the places of their placeholders, and back.

use bevy::asset::{AssetPath, RenderAssetUsages};
use bevy::image::Image;
use bevy::mesh::{Indices, Mesh, PrimitiveTopology};
use bevy::prelude::*;

use super::components::OnDemandPart;
use crate::lod::memory::{bytes_of_image, bytes_of_mesh};

/// Bytes of meshes and textures that are moved in one frame, but for the last one: what an upload to the GPU takes little
/// time for.
const BYTES_PER_FRAME: u64 = 8 << 20;

/// The places of a source or a level in the file of its model, and the placeholders that were there.
#[derive(Debug, Default)]
pub(super) struct Places {
    /// Textures come first: a mesh without them would be seen.
    textures: Vec<AssetId<Image>>,
    meshes: Vec<AssetId<Mesh>>,
    labels: Vec<String>,
    /// The placeholders of the first places.
    placeholders: Vec<Placeholder>,
}

#[derive(Debug)]
enum Placeholder {
    Texture(Image),
    Mesh(Mesh),
}

/// The outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Filled {
    /// There is more to do in the next frame.
    Partly,
    /// All is in place.
    All,
    /// The file lacks something, or the model is gone.
    Failed,
}

/// The assets of a game.
pub(super) struct Stores<'a> {
    pub(super) server: &'a AssetServer,
    pub(super) meshes: &'a mut Assets<Mesh>,
    pub(super) images: &'a mut Assets<Image>,
}

impl Places {
    pub(super) fn of(part: &OnDemandPart) -> Self {
        let textures = part.textures.iter().map(|handle| (handle.id(), handle.path()));
        let (textures, of_textures): (Vec<_>, Vec<_>) = textures.unzip();
        let meshes = part.meshes.iter().map(|handle| (handle.id(), handle.path()));
        let (meshes, of_meshes): (Vec<_>, Vec<_>) = meshes.unzip();
        let label = |path: Option<&AssetPath<'static>>| path.and_then(AssetPath::label).unwrap_or_default().to_owned();
        let labels = of_textures.into_iter().chain(of_meshes).map(label).collect();
        Self { textures, meshes, labels, placeholders: Vec::new() }
    }

    /// Moves some of the meshes and textures of `file` into their places.
    pub(super) fn fill(&mut self, file: &AssetPath<'static>, stores: &mut Stores<'_>) -> Filled {
        let mut bytes = 0;
        while bytes < BYTES_PER_FRAME {
            let Some(label) = self.labels.get(self.placeholders.len()) else { return Filled::All };
            let path = file.clone().with_label(label.clone());
            let place = self.placeholders.len();
            let moved = match self.textures.get(place) {
                Some(texture) => move_texture(path, *texture, stores),
                None => move_mesh(path, self.meshes[place - self.textures.len()], stores),
            };
            let Some((placeholder, size)) = moved else { return Filled::Failed };
            self.placeholders.push(placeholder);
            bytes += size;
        }
        Filled::Partly
    }

    /// Puts the placeholders back. Tells whether there were any.
    pub(super) fn empty(&mut self, stores: &mut Stores<'_>) -> bool {
        let textures = self.textures.len();
        let had_some = !self.placeholders.is_empty();
        for (place, placeholder) in self.placeholders.drain(..).enumerate() {
            // A model that is gone needs none.
            let _ = match placeholder {
                Placeholder::Texture(image) => stores.images.insert(self.textures[place], image),
                Placeholder::Mesh(mesh) => stores.meshes.insert(self.meshes[place - textures], mesh),
            };
        }
        had_some
    }

    /// Forgets the placeholders: the model was loaded again and has others.
    pub(super) fn forget(&mut self) {
        self.placeholders.clear();
    }

    /// Tells whether the model is still loaded.
    pub(super) fn is_loaded(&self, meshes: &Assets<Mesh>) -> bool {
        self.meshes.iter().all(|mesh| meshes.contains(*mesh))
    }
}

/// Moves a texture from the file of a part into its place. Returns the placeholder, and the bytes of the texture.
fn move_texture(path: AssetPath<'_>, place: AssetId<Image>, stores: &mut Stores<'_>) -> Option<(Placeholder, u64)> {
    let mut image = stores.images.remove(stores.server.get_handle::<Image>(path)?.id())?;
    let old = stores.images.get(place)?;
    image.asset_usage = old.asset_usage;
    let placeholder = match old.data {
        Some(_) => old.clone(),
        // The renderer has its texels.
        None => Image { asset_usage: old.asset_usage, ..Image::default() },
    };
    let bytes = bytes_of_image(&image);
    stores.images.insert(place, image).ok()?;
    Some((Placeholder::Texture(placeholder), bytes))
}

/// As [`move_texture`], for a mesh.
fn move_mesh(path: AssetPath<'_>, place: AssetId<Mesh>, stores: &mut Stores<'_>) -> Option<(Placeholder, u64)> {
    let mut mesh = stores.meshes.remove(stores.server.get_handle::<Mesh>(path)?.id())?;
    let bytes = bytes_of_mesh(&mesh);
    let old = stores.meshes.get(place)?;
    let usage = old.asset_usage;
    mesh.asset_usage = usage;
    let placeholder = if usage.contains(RenderAssetUsages::MAIN_WORLD) { old.clone() } else { nothing(usage) };
    stores.meshes.insert(place, mesh).ok()?;
    Some((Placeholder::Mesh(placeholder), bytes))
}

/// A mesh that shows nothing.
fn nothing(usage: RenderAssetUsages) -> Mesh {
    Mesh::new(PrimitiveTopology::TriangleList, usage)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, vec![[0.0_f32; 3]; 3])
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0_f32, 0.0, 1.0]; 3])
        .with_inserted_indices(Indices::U16(vec![0, 1, 2]))
}
