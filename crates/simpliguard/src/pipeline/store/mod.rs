//! What stages leave behind for later bakes: keys and encoding.
//!
//! Four kinds of objects pay for their space, because they cost much, are small, and most changes leave them as they
//! are:
//!
//! - what a candidate leads to, which depends on the form of the model alone: a saved texture finds it again;
//! - the shapes that win, which depend on what the model looks like, too: a setting of a later stage finds them again;
//! - the atlas of a mesh;
//! - where descent leaves the vertices of a level: a setting of its finish finds it again, as does a bake that was stopped.
//!
//! The vertices are left a second time under the mesh that they began as, whatever pictures they were moved by. This object is
//! the one whose key does not tell all of its content, and no result is made from it: it serves levels that are shown while the
//! result is made.
//!
//! An object's key holds the version of the chain and of its stage, the content that the stage reads, and the settings
//! that it reads. Objects are in the machine's own byte order: they stay on the machine that made them.

mod codec;
pub(crate) mod key;
mod keys;

use codec::{Reader, Writer};

pub(crate) use keys::{atlas_key, candidate_key, content_key, form_key, shapes_key, vertices_key, warm_start_key};

use crate::{Context, Error, Key};

/// Something that a [`crate::StageStore`] can keep.
pub(crate) trait Object: Sized {
    fn write(&self, writer: &mut Writer);
    /// `None` if these are not the bytes of such an object.
    fn read(reader: &mut Reader<'_>) -> Option<Self>;
}

impl Context<'_> {
    /// A key, if there is something to keep objects in.
    pub(crate) fn key(&self, key: impl FnOnce() -> Key) -> Option<Key> {
        self.stages.map(|_| key())
    }

    /// Whether there is something under a key.
    pub(crate) fn knows(&self, key: &Key) -> bool {
        self.stages.is_some_and(|stages| stages.get(key).is_some())
    }

    /// The object of a key of [`Self::key`]: one that was stored, or else what `make` makes, which is stored.
    pub(crate) fn stored<T: Object>(
        &self,
        key: Option<Key>,
        make: impl FnOnce() -> Result<T, Error>,
    ) -> Result<T, Error> {
        let Some(key) = key else { return make() };
        if let Some(object) = self.find(&key) {
            return Ok(object);
        }
        let made = make()?;
        self.leave(&key, &made);
        Ok(made)
    }

    /// The object of a key, if it is stored.
    pub(crate) fn find<T: Object>(&self, key: &Key) -> Option<T> {
        self.stages?.get(key).and_then(|bytes| decode(&bytes))
    }

    /// Stores an object. Whoever is cancelled may have made less than everything, and stores nothing.
    pub(crate) fn leave<T: Object>(&self, key: &Key, object: &T) {
        if let Some(stages) = self.stages.filter(|_| !self.cancellation.is_cancelled()) {
            stages.put(key, &encode(object));
        }
    }
}

fn encode<T: Object>(object: &T) -> Vec<u8> {
    let mut writer = Writer::default();
    object.write(&mut writer);
    writer.finish()
}

fn decode<T: Object>(bytes: &[u8]) -> Option<T> {
    let mut reader = Reader::new(bytes);
    let object = T::read(&mut reader)?;
    reader.is_at_end().then_some(object)
}
