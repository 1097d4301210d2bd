//! What stages leave behind for later bakes of the same model.

use bytes::Bytes;
use simpliguard::{Key, StageStore, content_hash};

use crate::store::USE_NOTED_AFTER;
use crate::{Cache, Durability};

/// Length of the hash that stands before an object's content.
const HASH: usize = blake3::OUT_LEN;

/// Storage that fails is a miss: the stage runs.
impl StageStore for Cache {
    fn get(&self, key: &Key) -> Option<Bytes> {
        let path = self.path("stages", key.as_bytes());
        let file = Bytes::from(self.read_file(&path).ok()??);
        if !is_whole(&file) {
            self.quarantine(path, "does not match its hash");
            return None;
        }
        self.note_use(&path, USE_NOTED_AFTER);
        Some(file.slice(HASH..))
    }

    fn put(&self, key: &Key, bytes: &[u8]) {
        let file = [content_hash(bytes).as_bytes(), bytes].concat();
        // Its hash tells whether all of it came to the disk.
        if self.write(&self.path("stages", key.as_bytes()), &file, Durability::Process).is_ok() {
            self.has_grown(file.len() as u64);
        }
    }
}

/// Whether the file of an object holds what was stored.
pub(crate) fn is_whole(file: &[u8]) -> bool {
    file.split_at_checked(HASH).is_some_and(|(hash, content)| content_hash(content).as_bytes() == hash)
}
