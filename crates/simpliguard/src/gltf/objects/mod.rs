//! The objects of a scene file: each becomes a file of its own, and their levels come back into the scene.
//!
//! ```text
//! scene -> find -> recipe -> copy -> files of objects -> (bakes) -> levels -> scene with levels
//! ```
//!
//! - `find.rs` divides the mesh nodes of the default scene into objects.
//! - `recipe.rs` describes an object without its place in the scene, so that moved, turned and mirrored instances have
//!   one description.
//! - `copy.rs` copies meshes, materials, textures and accessors from one document into another.
//! - `own_levels.rs` finds the levels that objects come with.
//! - `levels.rs` takes the levels out of the file of a baked object, and writes their nodes.
//! - `shared_atlas/` gives the smallest levels of all objects one texture set.
//! - `scene.rs` puts these steps together.
//! - `describe.rs` tells a scene from a single model.
//!
//! # Layout of a scene with levels
//! The scene's own objects keep their indices. Each instance of an object has a node for each of its levels; meshes,
//! materials and textures of levels are shared between instances. `extras.simpliguard` of a level node says `object`,
//! the node whose levels they are, and `replaces`, the mesh nodes that the level stands for. A level lies in the space of
//! the node `space`, or in that of the scene if there is none. Its own transform is that of `space`, so that it is a
//! sibling of that node, as `MSFT_lod` means it.

mod copy;
mod describe;
mod find;
mod levels;
mod own_levels;
mod recipe;
mod scene;
mod shared_atlas;

pub(crate) use describe::{SCENE_HINT, describe_scene};
pub(crate) use scene::ObjectScene;
