//! What must be known at the next start, as small files beside the processed assets.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use bevy::asset::AssetPath;
use simpliguard_cache::{Durability, write_atomic};

/// Where a game's processed assets are, and what is noted about them.
#[derive(Clone, Debug)]
pub(super) struct Journal {
    /// Root of the processed files of the default source.
    processed: PathBuf,
    /// Our own folder beside it. Bevy watches the other and would take what lies there for assets.
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

    /// A folder on the same file system as the processed files, which nobody watches.
    pub(super) fn scratch(&self) -> io::Result<PathBuf> {
        let folder = self.notes.join("scratch");
        fs::create_dir_all(&folder)?;
        Ok(folder)
    }

    /// Notes that the processed file is the model as it came, although it is to have levels.
    pub(super) fn begin(&self, path: &AssetPath<'static>) -> io::Result<()> {
        let content = path.path().to_string_lossy();
        write_atomic(&self.note("pending", path), content.as_bytes(), Durability::Process)
    }

    /// Takes back [`Self::begin`].
    pub(super) fn end(&self, path: &AssetPath<'static>) -> io::Result<()> {
        match fs::remove_file(self.note("pending", path)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed,
        }
    }

    /// Makes Bevy process those models again whose bakes did not end: it knows their processed files as up to date.
    /// Returns how many there are. Call it before the processor starts.
    pub(super) fn recover(&self) -> io::Result<usize> {
        let notes = match fs::read_dir(self.notes.join("pending")) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(0),
            notes => notes?,
        };
        let mut count = 0;
        for note in notes {
            let note = note?.path();
            let path = fs::read_to_string(&note)?;
            // A note names a file below the root, whatever happened to it.
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

    /// Notes the key of the latest levels of a model.
    pub(super) fn set_good(&self, path: &AssetPath<'static>, key: &str) -> io::Result<()> {
        let note = self.note("good", path);
        if fs::read(&note).is_ok_and(|there| there == key.as_bytes()) {
            return Ok(());
        }
        write_atomic(&note, key.as_bytes(), Durability::Process)
    }

    /// The key of the latest levels of a model.
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
