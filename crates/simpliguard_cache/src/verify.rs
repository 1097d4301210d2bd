//! Verification: reads the whole cache to find damaged files.

use rayon::prelude::*;
use simpliguard_key::content_hash;

use crate::error::StorageError;
use crate::inventory::{Amount, Inventory, StoredFile};
use crate::record::{MOST_RESULT_BYTES, Record};
use crate::stage_objects::is_whole;
use crate::store::Cache;

/// The outcome of [`Cache::verify`].
#[derive(Debug, Default)]
pub struct Verified {
    /// The files that were read.
    pub checked: Amount,
    /// Damaged files, which are in quarantine now, and files that could not be read; sorted by path.
    pub errors: Vec<StorageError>,
    /// Number of results that have lost an object. They count as misses, and the next collection removes them.
    pub incomplete: u64,
}

impl Cache {
    /// Reads and hashes all files on the rayon pool of the caller. Moves damaged files to quarantine.
    pub fn verify(&self) -> Verified {
        let inventory = Inventory::of(self);
        let records: Vec<&StoredFile> = inventory.results.iter().map(|result| &result.file).collect();
        let objects: Vec<&StoredFile> = inventory.objects.values().collect();
        let stages: Vec<&StoredFile> = inventory.stages.iter().collect();
        let is_record = |bytes: &[u8], file: &StoredFile| Record::parse(bytes, &file.hex).map(drop);
        let is_object = |bytes: &[u8], file: &StoredFile| matches(content_hash(bytes).to_hex().as_str() == file.hex);
        let is_stage = |bytes: &[u8], _: &StoredFile| matches(is_whole(bytes));
        let mut errors = self.check_files(&records, is_record);
        errors.extend(self.check_files(&objects, is_object));
        errors.extend(self.check_files(&stages, is_stage));
        let checked = records.iter().chain(&objects).chain(&stages).copied().collect();
        // Counted anew, because results have lost the objects that were just moved away.
        let incomplete = Inventory::of(self).results.iter().filter(|result| !result.is_complete).count() as u64;
        Verified { checked, errors, incomplete }
    }

    fn check_files(
        &self,
        files: &[&StoredFile],
        check: impl Fn(&[u8], &StoredFile) -> Result<(), String> + Sync,
    ) -> Vec<StorageError> {
        let check = |file: &&StoredFile| match self.read_file(&file.path, MOST_RESULT_BYTES) {
            // Somebody removed it meanwhile.
            Ok(None) => None,
            Ok(Some(bytes)) => check(&bytes, file).err().map(|reason| self.quarantine(file.path.clone(), &reason)),
            Err(error) => Some(error),
        };
        files.par_iter().filter_map(check).collect()
    }
}

fn matches(is_match: bool) -> Result<(), String> {
    if is_match { Ok(()) } else { Err("does not match its hash".into()) }
}
