//! The folder that belongs to the cache alone.
//!
//! The folder that a user gives may contain anything. All files of a cache lie in one folder below it. This folder gets
//! a marker when it is created. A folder without a marker belongs to somebody else: no file is written, moved or
//! removed there. Symbolic links are never followed, because they may lead anywhere.

use std::ffi::OsStr;
use std::fs::{self, FileType};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use crate::error::StorageError;
use crate::file::{Durability, is_temporary, replace};

/// The name of the folder. Another layout gets another name.
pub(crate) const NAME: &str = "simpliguard-v1";

/// The folders of files that are named by a hash: `ab/cdef..`.
pub(crate) const HASHED: [&str; 4] = ["results", "objects", "stages", "locks"];
pub(crate) const QUARANTINE: &str = "quarantine";

const MARKER: &str = "CACHEDIR.TAG";
/// The first line of the marker. Backup programs skip folders with such a marker.
const SIGNATURE: &str = "Signature: 8a477f597d28d172789f06886806bc55";
/// The second line of the marker, which only this program writes.
const OURS: &str = "# This folder is a cache of simpliguard.";
const EXPLANATION: &str = "# It may be deleted at any time. Files of your own do not belong here.";
/// Largest size of a marker in bytes.
const LONGEST_MARKER: u64 = 4096;

/// Number of tries to write a file while somebody deletes its folder.
const ATTEMPTS: u32 = 5;

/// The owner of the folder.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum State {
    /// There is no folder.
    Missing,
    /// The folder is empty, or has only temporary files of a process that ended before it wrote the marker.
    Empty,
    /// The folder has the marker.
    Ours,
    /// The folder belongs to somebody else. The text describes the content.
    Foreign(String),
}

/// The folder of a cache below the one that the user gave. It need not exist.
#[derive(Debug)]
pub(crate) struct OwnFolder {
    path: PathBuf,
}

impl OwnFolder {
    /// The folder below `root`. Touches nothing.
    pub(crate) fn new(root: &Path) -> Self {
        Self { path: root.join(NAME) }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The owner at the moment.
    pub(crate) fn state(&self) -> io::Result<State> {
        match kind(&self.path)? {
            None => return Ok(State::Missing),
            Some(kind) if !kind.is_dir() => return Ok(State::Foreign(describe(kind))),
            Some(_) => {}
        }
        if self.is_marked()? {
            return Ok(State::Ours);
        }
        let stranger = match names(&self.path) {
            Ok(names) => names.into_iter().find(|name| !is_temporary(name)),
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(State::Missing),
            Err(e) => return Err(e),
        };
        let Some(stranger) = stranger else { return Ok(State::Empty) };
        // Another process may have written its marker, and then more files, since the first check.
        if self.is_marked()? {
            return Ok(State::Ours);
        }
        let found = format!("it holds '{}' but no {MARKER} of this program", stranger.to_string_lossy());
        Ok(State::Foreign(found))
    }

    /// Tells whether the folder may be read.
    pub(crate) fn is_ours(&self) -> io::Result<bool> {
        self.state().map(|state| state == State::Ours)
    }

    /// Checks that the folder belongs to the cache, or is missing or empty.
    pub(crate) fn check(&self) -> Result<(), StorageError> {
        match self.state() {
            Ok(State::Foreign(found)) => Err(StorageError::Foreign { path: self.path.clone(), found }),
            Ok(_) => Ok(()),
            Err(source) => Err(StorageError::Io { action: "read", path: self.path.clone(), source }),
        }
    }

    /// Tells whether `path` is a file below the folder, without a symbolic link on the way.
    pub(crate) fn has_file(&self, path: &Path) -> io::Result<bool> {
        for folder in self.folders_to(path) {
            if !kind(folder)?.is_some_and(|kind| kind.is_dir()) {
                return Ok(false);
            }
        }
        Ok(kind(path)?.is_some_and(|kind| kind.is_file()))
    }

    /// Creates all folders above `path`, which lies below the folder, and calls `act` to write `path`.
    pub(crate) fn write<T>(&self, path: &Path, act: impl Fn(&Path) -> io::Result<T>) -> Result<T, StorageError> {
        let failed = |source| StorageError::Io { action: "write", path: path.to_owned(), source };
        for _ in 1..ATTEMPTS {
            match self.prepare(path).and_then(|()| act(path).map_err(failed)) {
                // Somebody deleted a folder after it was prepared.
                Err(StorageError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {}
                done => return done,
            }
        }
        self.prepare(path).and_then(|()| act(path).map_err(failed))
    }

    /// Removes every empty folder that the cache has created. If only the marker is left, removes the marker and the
    /// folder itself.
    pub(crate) fn remove_empty(&self) {
        for folder in HASHED.map(|name| self.path.join(name)) {
            let parts = if is_folder(&folder) { names(&folder).unwrap_or_default() } else { Vec::new() };
            for part in parts.iter().filter(|name| is_hex(name, 2)) {
                remove_folder(&folder.join(part));
            }
            remove_folder(&folder);
        }
        remove_folder(&self.path.join(QUARANTINE));
        if names(&self.path).is_ok_and(|names| names.iter().all(|name| name == MARKER)) {
            let _ = fs::remove_file(self.path.join(MARKER));
            remove_folder(&self.path);
            // A writer was faster. Without a marker, its files would look like somebody else's.
            if is_folder(&self.path) {
                let _ = self.mark();
            }
        }
    }

    /// Creates the folders above `path`, one level at a time: if the folder of the cache is deleted meanwhile, it does
    /// not come back without its marker.
    fn prepare(&self, path: &Path) -> Result<(), StorageError> {
        self.claim()?;
        for folder in self.folders_to(path) {
            let failed = |source| StorageError::Io { action: "write", path: folder.to_owned(), source };
            match kind(folder).map_err(failed)? {
                None => make_folder(folder).map_err(failed)?,
                Some(kind) if kind.is_dir() => {}
                Some(kind) => return Err(StorageError::Foreign { path: folder.to_owned(), found: describe(kind) }),
            }
        }
        match kind(path) {
            Ok(Some(kind)) if !kind.is_file() => {
                Err(StorageError::Foreign { path: path.to_owned(), found: describe(kind) })
            }
            Ok(_) => Ok(()),
            Err(source) => Err(StorageError::Io { action: "write", path: path.to_owned(), source }),
        }
    }

    /// Creates the folder if it is missing, and writes the marker if it is empty.
    fn claim(&self) -> Result<(), StorageError> {
        let failed = |source| StorageError::Io { action: "write", path: self.path.clone(), source };
        let mut state = self.state().map_err(failed)?;
        if state == State::Missing {
            self.path.parent().map_or(Ok(()), fs::create_dir_all).map_err(failed)?;
            make_folder(&self.path).map_err(failed)?;
            state = self.state().map_err(failed)?;
        }
        match state {
            State::Ours => Ok(()),
            State::Empty => self.mark().map_err(failed),
            State::Missing => Err(failed(ErrorKind::NotFound.into())),
            State::Foreign(found) => Err(StorageError::Foreign { path: self.path.clone(), found }),
        }
    }

    /// Writes the marker. Several processes may do so at the same time, because their markers are equal.
    fn mark(&self) -> io::Result<()> {
        let text = [SIGNATURE, OURS, EXPLANATION, ""].join("\n");
        // After a loss of power, an empty marker would make the folder look like somebody else's.
        replace(&self.path, &self.path.join(MARKER), text.as_bytes(), Durability::PowerLoss)
    }

    fn is_marked(&self) -> io::Result<bool> {
        let path = self.path.join(MARKER);
        let is_marker = |data: &fs::Metadata| data.is_file() && data.len() <= LONGEST_MARKER;
        match fs::symlink_metadata(&path).and_then(|data| is_marker(&data).then(|| fs::read(&path)).transpose()) {
            Ok(Some(bytes)) => Ok(String::from_utf8_lossy(&bytes).lines().take(2).eq([SIGNATURE, OURS])),
            Ok(None) => Ok(false),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(false),
            Err(e) => Err(e),
        }
    }

    /// The folders between this one and `path`, from the outside inwards.
    fn folders_to<'a>(&self, path: &'a Path) -> impl Iterator<Item = &'a Path> {
        let above = path.ancestors().skip(1).take_while(|folder| *folder != self.path);
        above.collect::<Vec<_>>().into_iter().rev()
    }
}

/// Tells whether `path` is a folder, not a link to one.
pub(crate) fn is_folder(path: &Path) -> bool {
    kind(path).is_ok_and(|kind| kind.is_some_and(|kind| kind.is_dir()))
}

/// Tells whether a name consists of `digits` lowercase hexadecimal digits.
pub(crate) fn is_hex(name: &OsStr, digits: usize) -> bool {
    let is_digit = |byte: &u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
    name.len() == digits && name.as_encoded_bytes().iter().all(is_digit)
}

/// The type of `path` itself; links are not followed. `None` if there is nothing.
fn kind(path: &Path) -> io::Result<Option<FileType>> {
    match fs::symlink_metadata(path) {
        Ok(data) => Ok(Some(data.file_type())),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(e),
    }
}

fn describe(kind: FileType) -> String {
    let what = match kind {
        kind if kind.is_symlink() => "a symbolic link",
        kind if kind.is_dir() => "a folder",
        kind if kind.is_file() => "a file",
        _ => "a special file",
    };
    format!("it is {what}")
}

fn names(folder: &Path) -> io::Result<Vec<std::ffi::OsString>> {
    fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.file_name())).collect()
}

/// Creates a folder. It is no error if another process has just created it.
fn make_folder(path: &Path) -> io::Result<()> {
    match fs::create_dir(path) {
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(()),
        made => made,
    }
}

/// Removes a folder if it is empty and not a link. (On Windows, `remove_dir` also removes links.)
fn remove_folder(path: &Path) {
    if is_folder(path) {
        let _ = fs::remove_dir(path);
    }
}
