//! One texture set for the smallest levels of all objects, so that a game draws them with one material.
//!
//! Each level brings a tile: its square textures, or its plain colours. Tiles are halved alike until they fit, laid out without
//! gaps, and the texture coordinates of the levels move into them. Materials that differ in how they treat alpha, backs or
//! light stay apart, but show the same textures. Clear surfaces keep their own.

mod compose;
mod pack;
mod tile;

use glam::Vec2;
use serde_json::{Value, json};

use self::compose::Composed;
use self::pack::{Layout, Place};
use self::tile::{LEAST_SIDE, Mode, Tile};
use crate::data::TextureFormat;
use crate::gltf::export::builder::{Builder, Kind, index};
use crate::gltf::export::material::push_material;
use crate::gltf::export::textures::{EncodedTextures, push_sampler};
use crate::{Cancellation, Error};

/// The textures that levels will share.
#[derive(Clone)]
pub(super) struct SharedAtlas {
    /// Largest side in texels, a power of two.
    side: u32,
    format: TextureFormat,
    tiles: Vec<Tile>,
    parts: Vec<Part>,
}

/// A primitive of the scene that shows a tile.
#[derive(Clone)]
struct Part {
    mesh: usize,
    primitive: usize,
    tile: usize,
}

/// The primitives of a mesh whose materials were taken, each with its tile.
pub(super) struct Taken(Vec<(usize, usize)>);

impl SharedAtlas {
    /// An empty atlas of at most `side` texels a side, a power of two.
    pub(super) fn new(side: u32, format: TextureFormat) -> Self {
        Self { side, format, tiles: Vec::new(), parts: Vec::new() }
    }

    /// Takes the materials of a level out of the file of its object, as far as others can share them and there is room.
    pub(super) fn take_materials(&mut self, from: &mut Builder, mesh: usize) -> Taken {
        let room = (self.side / LEAST_SIDE).pow(2) as usize;
        let primitives = from.all(Kind::Mesh).get(mesh).and_then(|mesh| mesh.get("primitives")?.as_array());
        let materials: Vec<Option<usize>> = primitives
            .into_iter()
            .flatten()
            .map(|p| index(p, "material").filter(|_| is_in_unit_square(from, p)))
            .collect();
        let mut taken = Vec::new();
        for (primitive, material) in materials.into_iter().enumerate().filter_map(|(i, m)| Some((i, m?))) {
            let tile = Tile::read(from, material).filter(|_| self.tiles.len() < room);
            let Some((tile, primitives)) = tile.zip(from.all_mut(Kind::Mesh)[mesh]["primitives"].as_array_mut()) else {
                continue;
            };
            primitives[primitive].as_object_mut().and_then(|members| members.remove("material"));
            taken.push((primitive, self.tiles.len()));
            self.tiles.push(tile);
        }
        Taken(taken)
    }

    /// Gives the shared material to a mesh of the scene: the copy of the one whose materials were taken.
    pub(super) fn add(&mut self, mesh: usize, taken: Taken) {
        self.parts.extend(taken.0.into_iter().map(|(primitive, tile)| Part { mesh, primitive, tile }));
    }

    /// Writes the textures and their materials into the scene, and moves the texture coordinates. Returns the side of the
    /// textures in texels; `None` if there are none: all levels have one plain colour, or no level shares its material.
    ///
    /// # Errors
    /// If a texture of a level cannot be read, and the error of a bake that was cancelled.
    pub(super) fn write(self, out: &mut Builder, cancellation: &Cancellation) -> Result<Option<u32>, Error> {
        if self.tiles.is_empty() {
            return Ok(None);
        }
        let layout = Layout::new(&self.tiles.iter().map(Tile::side).collect::<Vec<_>>(), self.side);
        let Composed { textures, material } =
            compose::compose(&out.asset, &self.tiles, &layout, self.format, cancellation)?;
        let has_alpha = self.tiles.iter().any(|tile| tile.mode.has_alpha());
        let is_textured = !textures.is_empty();
        let textures = EncodedTextures::new(&out.asset, &textures, has_alpha, cancellation)?;
        let sampler = push_sampler(out);
        let textures = textures.write(out, sampler);
        let mut written: Vec<(Mode, usize)> = Vec::new();
        for Part { mesh, primitive, tile } in self.parts {
            let mode = self.tiles[tile].mode;
            let known = written.iter().find(|(other, _)| *other == mode).map(|(_, material)| *material);
            let material = known.unwrap_or_else(|| push_material(out, "Objects", &mode.apply(&material), &textures));
            written.extend(known.is_none().then_some((mode, material)));
            let primitive = &mut out.all_mut(Kind::Mesh)[mesh]["primitives"][primitive];
            primitive["material"] = json!(material);
            if let Some(accessor) = primitive.get("attributes").and_then(|a| index(a, "TEXCOORD_0")) {
                move_into(out, accessor, layout.places[tile], layout.side);
            }
        }
        Ok(is_textured.then_some(layout.side))
    }
}

/// True if all texture coordinates of a primitive of a level lie in the texture: none repeats it, as the source's materials may
/// that a level has kept.
fn is_in_unit_square(from: &Builder, primitive: &Value) -> bool {
    let uvs = || {
        let accessor = from.all(Kind::Accessor).get(index(primitive.get("attributes")?, "TEXCOORD_0")?)?;
        let view = from.all(Kind::BufferView).get(index(accessor, "bufferView")?)?;
        let start = index(view, "byteOffset").unwrap_or(0);
        from.bin.get(start..start.checked_add(size_of::<Vec2>().checked_mul(index(accessor, "count")?)?)?)
    };
    let numbers = |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().all(|c| (0.0..=1.0).contains(&f32::from_le_bytes(*c)));
    uvs().is_some_and(numbers)
}

/// Moves texture coordinates from a texture of their own into its place. Half a texel stays free at the borders, so that a
/// filter does not reach the neighbours.
fn move_into(out: &mut Builder, accessor: usize, place: Place, side: u32) {
    let accessor = &out.all(Kind::Accessor)[accessor];
    let count = index(accessor, "count").unwrap_or(0);
    let view = index(accessor, "bufferView").and_then(|view| out.all(Kind::BufferView).get(view));
    let Some(start) = view.map(|view| index(view, "byteOffset").unwrap_or(0)) else { return };
    let (corner, size, border) = (place.corner.map(|c| c as f32), place.side as f32, 0.5 / place.side as f32);
    let Some(bytes) = out.bin.get_mut(start..).and_then(|bytes| bytes.get_mut(..8 * count)) else { return };
    for pair in bytes.chunks_exact_mut(8) {
        let [mut u, mut v] = [0, 4].map(|at| f32::from_le_bytes([pair[at], pair[at + 1], pair[at + 2], pair[at + 3]]));
        (u, v) = (u.clamp(border, 1.0 - border), v.clamp(border, 1.0 - border));
        let moved = (Vec2::from(corner) + Vec2::new(u, v) * size) / side as f32;
        pair[..4].copy_from_slice(&moved.x.to_le_bytes());
        pair[4..].copy_from_slice(&moved.y.to_le_bytes());
    }
}

#[cfg(test)]
mod tests;
