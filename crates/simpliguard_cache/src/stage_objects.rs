//! Stage objects: intermediate objects that later computations take up again.

use bytes::Bytes;
use simpliguard_key::{Key, content_hash};

use crate::file::Durability;
use crate::record::MOST_RESULT_BYTES;
use crate::store::{Cache, USE_NOTED_AFTER};

/// Length in bytes of the hash that stands before the content of a stage object.
const HASH: usize = blake3::OUT_LEN;

impl Cache {
    /// The stage object of a key, checked against its hash. `None` if there is none, or if it cannot be read.
    pub fn get_stage_object(&self, key: &Key) -> Option<Bytes> {
        let path = self.path("stages", key.as_bytes());
        let file = Bytes::from(self.read_file(&path, MOST_RESULT_BYTES).ok()??);
        if !is_whole(&file) {
            self.quarantine(path, "does not match its hash");
            return None;
        }
        self.note_use(&path, USE_NOTED_AFTER);
        Some(file.slice(HASH..))
    }

    /// Stores a stage object. A storage error is ignored: the object is then a miss.
    pub fn put_stage_object(&self, key: &Key, content: &[u8]) {
        let file = [content_hash(content).as_bytes(), content].concat();
        // No sync: after a loss of power, the hash tells whether the file is whole.
        if self.write(&self.path("stages", key.as_bytes()), &file, Durability::Process).is_ok() {
            self.has_grown(file.len() as u64);
        }
    }
}

/// Tells whether the file of a stage object holds the bytes that were stored.
pub(crate) fn is_whole(file: &[u8]) -> bool {
    file.split_at_checked(HASH).is_some_and(|(hash, content)| content_hash(content).as_bytes() == hash)
}
