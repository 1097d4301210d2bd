//! Counts bakes that ended with the game: a model that has crashed it twice is left as it is.
//!
//! A decoder that aborts or a machine without memory takes the whole game with it, and so would the next start. So a note
//! is written before each bake and removed behind it, and also when the game ends as it should.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::{fs, io};

use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use simpliguard::{Error, Key, StageId};
use simpliguard_cache::{Durability, write_atomic};

/// A model is not baked any more after so many bakes that have ended the game.
const MOST: u32 = 2;

/// The notes on bakes that run, or that have ended the game.
#[derive(Debug)]
pub(super) struct Attempts {
    folder: PathBuf,
    /// Bakes of this process that run.
    running: Mutex<HashSet<Key>>,
}

impl Attempts {
    /// With notes in `folder`, which need not exist yet.
    pub(super) fn new(folder: PathBuf) -> Self {
        Self { folder, running: Mutex::default() }
    }

    /// Notes that a bake begins.
    ///
    /// # Errors
    /// If bakes with this key have ended the game twice. A note that cannot be written is no error.
    pub(super) fn begin(&self, model: &str, key: Key) -> Result<(), Error> {
        let note = self.note(&key);
        let ended = count(&note);
        if ended >= MOST {
            let found = format!("{ended} bakes of this model have ended with a crash of the game: it is left as it is");
            let advice = format!("change it or its settings, or remove '{}' to try again", note.display());
            return Err(Error::invalid(model, StageId::Import, found, advice));
        }
        if let Err(error) = write_atomic(&note, (ended + 1).to_string().as_bytes(), Durability::Process) {
            debug!("{model}: a crash would not be noticed: {error}");
        }
        self.running.lock().unwrap_or_else(PoisonError::into_inner).insert(key);
        Ok(())
    }

    /// Removes the note of a bake that has ended, with or without a result.
    pub(super) fn end(&self, key: Key) {
        if self.running.lock().unwrap_or_else(PoisonError::into_inner).remove(&key) {
            self.forget(&key);
        }
    }

    /// Removes the notes of all bakes that run: the game ends as it should.
    pub(super) fn end_all(&self) {
        let running = std::mem::take(&mut *self.running.lock().unwrap_or_else(PoisonError::into_inner));
        running.iter().for_each(|key| self.forget(key));
    }

    fn forget(&self, key: &Key) {
        let removed = fs::remove_file(self.note(key));
        if let Err(error) = removed.or_else(|e| if e.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(e) }) {
            debug!("'{}': {error}", self.note(key).display());
        }
    }

    fn note(&self, key: &Key) -> PathBuf {
        self.folder.join(key.hex())
    }
}

/// The number in a note; 0 if there is none, or if it is damaged.
fn count(note: &Path) -> u32 {
    fs::read_to_string(note).ok().and_then(|text| text.trim().parse().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use simpliguard::KeyBuilder;

    use super::*;

    fn key(name: &str) -> Key {
        KeyBuilder::new(name).finish()
    }

    #[test]
    fn a_model_that_ended_the_game_twice_is_left_as_it_is() {
        let dir = tempfile::tempdir().expect("tempdir");
        let start = || Attempts::new(dir.path().join("attempts"));
        for _ in 0..2 {
            // Nothing removes the note: the game has crashed.
            start().begin("a.glb", key("1")).expect("may try");
        }
        let text = start().begin("a.glb", key("1")).expect_err("twice is enough").to_string();
        assert!(text.starts_with("a.glb: import: 2 bakes") && text.contains("attempts"), "{text}");
        start().begin("a.glb", key("2")).expect("another version of the model");
        fs::remove_file(start().note(&key("1"))).expect("there");
        start().begin("a.glb", key("1")).expect("may try again");
    }

    #[test]
    fn bakes_that_end_leave_no_note() {
        let dir = tempfile::tempdir().expect("tempdir");
        let attempts = Attempts::new(dir.path().join("attempts"));
        for _ in 0..3 {
            attempts.begin("a.glb", key("1")).expect("begins");
            attempts.end(key("1"));
        }
        for _ in 0..3 {
            attempts.begin("a.glb", key("1")).expect("begins");
            attempts.begin("b.glb", key("2")).expect("begins");
            attempts.end_all();
        }
        assert_eq!(fs::read_dir(dir.path().join("attempts")).expect("reads").count(), 0);
    }

    #[test]
    fn the_end_of_one_game_forgives_no_crash_of_an_earlier_one() {
        let dir = tempfile::tempdir().expect("tempdir");
        for _ in 0..2 {
            Attempts::new(dir.path().into()).begin("a.glb", key("1")).expect("may try");
        }
        let attempts = Attempts::new(dir.path().into());
        attempts.begin("a.glb", key("1")).expect_err("twice is enough");
        attempts.end(key("1"));
        attempts.end_all();
        attempts.begin("a.glb", key("1")).expect_err("as before");
    }
}
