//! The stage store: keys and encoding of the objects that later bakes find again.
//!
//! Five kinds of objects pay for their space. They cost much, are small, and most changes leave them as they are:
//!
//! - the shapes of a candidate, which depend on the form of the model alone: a bake after a change of a texture finds them;
//! - the selected shapes, which depend on the look of the model, too: a bake after a change of a later stage finds them;
//! - which of its selected shapes a level is made from;
//! - the atlas of a mesh;
//! - the refined vertices of a level: a bake after a change of the texture set finds them, as does a bake that was stopped.
//!
//! The vertices are stored a second time under the mesh that they began as, whatever views they were fitted to. This key
//! does not tell all of its content, and no result is made from it. It is the warm start of previews.
//!
//! The key of an object is a hash of the versions of the pipeline and of its stage, of the parameters of the stage, and of
//! the keys or the content of its inputs. Objects are in the byte order of the machine: they stay on the machine that
//! made them.

mod codec;
mod keys;
mod stored;

use crate::data::Atlas;
use crate::refine::Refined;
use crate::simplify::{Selected, Shape};

pub use keys::bake_key;
pub(crate) use keys::{
    atlas_key, candidate_key, choice_key, content_key, form_key, lattices_key, shapes_key, vertices_key, warm_start_key,
};
pub(crate) use stored::{Stored, decode, encode};

/// Tells whether bytes are an object of some stage. A bake knows which kind it expects; this is for the tests of the decoders.
#[doc(hidden)]
pub fn is_stage_object(bytes: &[u8]) -> bool {
    decode::<Vec<Shape>>(bytes).is_some()
        || decode::<Vec<Selected>>(bytes).is_some()
        || decode::<Refined>(bytes).is_some()
        || decode::<Atlas>(bytes).is_some()
}
