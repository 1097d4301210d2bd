//! The journal: facts that the next start needs, as small files beside the processed assets.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use bevy::asset::AssetPath;
use simpliguard_cache::{Durability, remove_stale_temporaries, write_atomic};

use crate::lod::on_demand::SOURCE;

/// The processed assets of a game, and the notes on them.
#[derive(Clone, Debug)]
pub(super) struct Journal {
    /// Root of the processed files of the default source.
    processed: PathBuf,
    /// The folder of the notes, beside the other one: Bevy would take files in the folder of processed files for
    /// assets.
    notes: PathBuf,
}

impl Journal {
    pub(super) fn new(processed: PathBuf) -> Self {
        let beside = processed.parent().unwrap_or(Path::new("")).join(".simpliguard");
        Self { processed, notes: beside }
    }

    /// The processed file of a model of the default source.
    pub(super) fn processed_file(&self, path: &AssetPath<'static>) -> PathBuf {
        self.processed.join(path.path())
    }

    /// The folder of the sources that are loaded on demand.
    pub(super) fn sources(&self) -> PathBuf {
        self.processed.parent().unwrap_or(Path::new("")).join(SOURCE)
    }

    /// The folder of the source of a model that is loaded on demand.
    pub(super) fn source_folder(&self, path: &AssetPath<'static>) -> PathBuf {
        self.sources().join(path.path())
    }

    /// A folder on the same file system as the processed files. No watcher watches it.
    pub(super) fn scratch(&self) -> io::Result<PathBuf> {
        let folder = self.notes.join("scratch");
        fs::create_dir_all(&folder)?;
        Ok(folder)
    }

    /// The folder of notes on bakes that run.
    pub(super) fn attempts(&self) -> PathBuf {
        self.notes.join("attempts")
    }

    /// Removes temporary files that killed games have left in the folders of notes.
    pub(super) fn remove_stale_temporaries(&self) {
        for folder in ["scratch", "pending", "good", "attempts"] {
            remove_stale_temporaries(&self.notes.join(folder));
        }
    }

    /// Notes that the levels of a model are still to be baked.
    pub(super) fn begin(&self, path: &AssetPath<'static>) -> io::Result<()> {
        let content = path.path().to_string_lossy();
        write_atomic(&self.note("pending", path), content.as_bytes(), Durability::Process)
    }

    /// Removes the note of [`Self::begin`].
    pub(super) fn end(&self, path: &AssetPath<'static>) -> io::Result<()> {
        match fs::remove_file(self.note("pending", path)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed,
        }
    }

    /// Makes Bevy process the models again whose bakes did not end, by removing their processed files: otherwise Bevy
    /// takes these files for up to date. Returns the number of models. Call it before the processor starts.
    pub(super) fn recover(&self) -> io::Result<usize> {
        let notes = match fs::read_dir(self.notes.join("pending")) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(0),
            notes => notes?,
        };
        let mut count = 0;
        for note in notes {
            let note = note?.path();
            let path = fs::read_to_string(&note)?;
            // A damaged note must not lead out of the folder.
            let inside = Path::new(&path).components().all(|c| matches!(c, std::path::Component::Normal(_)));
            if inside && !path.is_empty() {
                let file = self.processed.join(&path);
                let mut meta = file.clone().into_os_string();
                meta.push(".meta");
                for stale in [file, meta.into()] {
                    remove(&stale)?;
                }
                count += 1;
            }
            remove(&note)?;
        }
        Ok(count)
    }

    /// Notes the key of the last levels of a model.
    pub(super) fn set_good(&self, path: &AssetPath<'static>, key: &str) -> io::Result<()> {
        let note = self.note("good", path);
        if fs::read(&note).is_ok_and(|there| there == key.as_bytes()) {
            return Ok(());
        }
        write_atomic(&note, key.as_bytes(), Durability::Process)
    }

    /// The key of the last levels of a model.
    pub(super) fn good(&self, path: &AssetPath<'static>) -> Option<String> {
        fs::read_to_string(self.note("good", path)).ok()
    }

    fn note(&self, folder: &str, path: &AssetPath<'static>) -> PathBuf {
        let hash = blake3::hash(path.path().as_os_str().as_encoded_bytes()).to_hex();
        self.notes.join(folder).join(&hash[..32])
    }
}

fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unfinished_bake_is_processed_again_and_a_finished_one_is_not() {
        let dir = tempfile::tempdir().expect("tempdir");
        let journal = Journal::new(dir.path().join("imported/Default"));
        let [open, done]: [AssetPath<'static>; 2] = ["a/open.glb", "done.glb"].map(AssetPath::from);
        for path in [&open, &done] {
            let file = journal.processed_file(path);
            fs::create_dir_all(file.parent().expect("parent")).expect("makes");
            fs::write(&file, "x").expect("writes");
            fs::write(file.with_extension("glb.meta"), "x").expect("writes");
            journal.begin(path).expect("notes");
        }
        journal.end(&done).expect("takes back");
        journal.end(&done).expect("twice is no harm");
        assert_eq!(journal.recover().expect("recovers"), 1);
        assert!(
            !journal.processed_file(&open).exists()
                && !journal.processed_file(&open).with_extension("glb.meta").exists()
        );
        assert!(journal.processed_file(&done).exists());
        assert_eq!(journal.recover().expect("recovers"), 0);
    }

    #[test]
    fn a_note_that_leads_elsewhere_removes_nothing() {
        let dir = tempfile::tempdir().expect("tempdir");
        let journal = Journal::new(dir.path().join("imported/Default"));
        let victim = dir.path().join("imported/victim");
        fs::create_dir_all(dir.path().join("imported/.simpliguard/pending")).expect("makes");
        fs::write(&victim, "x").expect("writes");
        fs::write(dir.path().join("imported/.simpliguard/pending/1"), "../victim").expect("writes");
        assert_eq!(journal.recover().expect("recovers"), 0);
        assert!(victim.exists());
    }

    #[test]
    fn the_latest_good_key_is_kept() {
        let dir = tempfile::tempdir().expect("tempdir");
        let journal = Journal::new(dir.path().join("imported/Default"));
        let path = AssetPath::from("a.glb");
        assert_eq!(journal.good(&path), None);
        journal.set_good(&path, "1").expect("notes");
        journal.set_good(&path, "2").expect("notes");
        assert_eq!(journal.good(&path).as_deref(), Some("2"));
    }
}
