//! Reading all of a cache to find what is damaged.

use rayon::prelude::*;
use simpliguard::content_hash;

use crate::inventory::{Inventory, StoredFile};
use crate::record::Record;
use crate::stages::is_whole;
use crate::{Amount, Cache, StorageError};

/// What [`Cache::verify`] has found.
#[derive(Debug, Default)]
pub struct Verified {
    /// Files that were read.
    pub checked: Amount,
    /// What is damaged and in quarantine now, or could not be read; in the order of the paths.
    pub errors: Vec<StorageError>,
    /// Results whose objects are not all there; they count as misses and go with the next collection.
    pub incomplete: u64,
}

impl Cache {
    /// Reads and hashes everything, on the rayon pool of the caller, and moves what is damaged to quarantine.
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
        // What was moved away is missing from its results.
        let incomplete = Inventory::of(self).results.iter().filter(|result| !result.is_complete).count() as u64;
        Verified { checked, errors, incomplete }
    }

    fn check_files(
        &self,
        files: &[&StoredFile],
        check: impl Fn(&[u8], &StoredFile) -> Result<(), String> + Sync,
    ) -> Vec<StorageError> {
        let check = |file: &&StoredFile| match self.read_file(&file.path) {
            // It went meanwhile.
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
