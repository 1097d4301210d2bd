//! Atomic writes: a reader sees the whole file or no file.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

use tempfile::{NamedTempFile, PersistError};

use crate::retry::Backoff;

/// The beginning and the end of the names of temporary files.
const TEMPORARY: [&str; 2] = [".simpliguard-", ".tmp"];
/// Number of random characters between them.
const RANDOM: usize = 6;
/// A temporary file that was written to at a later time may still be in use.
const STALE: Duration = Duration::from_secs(3600);

/// The event that a written file must survive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// The end of the process.
    Process,
    /// A loss of power: the file is synced to the disk before it gets its name.
    PowerLoss,
}

/// Writes `bytes` to a temporary file in the folder of `path` and renames it to `path`. Creates the folder if it is
/// missing. If anything fails, `path` stays as it was.
pub fn write_atomic(path: &Path, bytes: &[u8], durability: Durability) -> io::Result<()> {
    write_atomic_through(folder_of(path), path, bytes, durability)
}

/// Like [`write_atomic`], with the temporary file in `scratch`, a folder on the same file system. It is for folders
/// that a program watches.
pub fn write_atomic_through(scratch: &Path, path: &Path, bytes: &[u8], durability: Durability) -> io::Result<()> {
    fs::create_dir_all(folder_of(path))?;
    fs::create_dir_all(scratch)?;
    replace(scratch, path, bytes, durability)
}

/// Like [`write_atomic_through`], but creates no folder.
pub(crate) fn replace(scratch: &Path, path: &Path, bytes: &[u8], durability: Durability) -> io::Result<()> {
    let mut file = temporary_in(scratch)?;
    file.write_all(bytes)?;
    if durability == Durability::PowerLoss {
        file.as_file().sync_all()?;
    }
    persist(file, path)
}

fn temporary_in(scratch: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY[0]).rand_bytes(RANDOM).suffix(TEMPORARY[1]);
    #[cfg(unix)]
    {
        // Temporary files are private by default. This one gets the permissions of any new file: those of the umask.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(scratch)
}

/// Tells whether a name is that of a temporary file of this program.
pub(crate) fn is_temporary(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(TEMPORARY[0].as_bytes()) && name.ends_with(TEMPORARY[1].as_bytes())
}

/// Removes the temporary files in `folder` that killed processes have left there. Files that were written within the last
/// hour stay, because another process may be writing them. Failures are ignored: the next call tries again.
pub fn remove_stale_temporaries(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten().filter(|entry| is_generated(&entry.file_name())) {
        // A link is not followed.
        let is_stale = |data: &fs::Metadata| {
            data.is_file() && data.modified().is_ok_and(|time| time.elapsed().is_ok_and(|age| age > STALE))
        };
        if entry.metadata().is_ok_and(|data| is_stale(&data)) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Tells whether a name has the exact form of a generated one. In a folder of the user, nothing else is removed.
fn is_generated(name: &OsStr) -> bool {
    let middle = name.to_str().and_then(|name| name.strip_prefix(TEMPORARY[0])?.strip_suffix(TEMPORARY[1]));
    middle.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// The folder of a file.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Checks that a file can be created in `folder`. Leaves nothing behind.
///
/// # Errors
/// The reason why no file can be created.
pub fn can_write_in(folder: &Path) -> io::Result<()> {
    tempfile::tempfile_in(folder).map(drop)
}

/// Renames a temporary file. If another program has the target open, tries again for a short time.
fn persist(file: NamedTempFile, path: &Path) -> io::Result<()> {
    persist_with(Backoff::for_replacing(), file, |file| file.persist(path))
}

fn persist_with(
    mut backoff: Backoff,
    mut file: NamedTempFile,
    mut rename: impl FnMut(NamedTempFile) -> Result<File, PersistError>,
) -> io::Result<()> {
    loop {
        match rename(file) {
            Ok(_) => return Ok(()),
            Err(failed) => {
                file = failed.file;
                backoff.pause_after(failed.error)?;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_replaced_and_nothing_else_stays() {
        let dir = tempfile::tempdir().expect("tempdir");
        let path = dir.path().join("a/b.bin");
        write_atomic(&path, b"one", Durability::PowerLoss).expect("writes");
        write_atomic(&path, b"two", Durability::Process).expect("replaces");
        assert_eq!(fs::read(&path).expect("reads"), b"two");
        assert_eq!(fs::read_dir(dir.path().join("a")).expect("lists").count(), 1);
    }

    #[test]
    fn trying_a_folder_leaves_nothing_in_it() {
        let dir = tempfile::tempdir().expect("tempdir");
        can_write_in(dir.path()).expect("writable");
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 0);
        assert!(can_write_in(&dir.path().join("none")).is_err());
    }

    #[test]
    fn a_file_that_a_game_is_reading_is_replaced_when_it_is_closed() {
        let dir = tempfile::tempdir().expect("tempdir");
        let path = dir.path().join("model.glb");
        fs::write(&path, b"old").expect("writes");
        let replace = |tries: u32| {
            let mut file = NamedTempFile::new_in(dir.path()).expect("creates");
            file.write_all(b"new").expect("writes");
            let mut left = tries;
            persist_with(Backoff::of_windows(), file, |file| {
                let Some(less) = left.checked_sub(1) else { return file.persist(&path) };
                left = less;
                Err(PersistError { error: io::Error::from_raw_os_error(32), file })
            })
        };
        assert_eq!(replace(100).expect_err("stays open").raw_os_error(), Some(32));
        assert_eq!(fs::read(&path).expect("reads"), b"old");
        replace(3).expect("is closed");
        assert_eq!(fs::read(&path).expect("reads"), b"new");
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 1);
    }

    #[test]
    fn stale_temporary_files_are_removed_and_nothing_else() {
        let dir = tempfile::tempdir().expect("tempdir");
        let write = |name: &str, age: u64| {
            let file = File::create(dir.path().join(name)).expect("creates");
            file.set_modified(std::time::SystemTime::now() - Duration::from_secs(age)).expect("sets the time");
        };
        write(".simpliguard-a1B2c3.tmp", 7200);
        for (name, age) in [
            (".simpliguard-d4E5f6.tmp", 60),
            (".simpliguard-notes.tmp", 7200),
            (".simpliguard-my work.tmp", 7200),
            ("fox.glb", 7200),
        ] {
            write(name, age);
        }
        fs::create_dir(dir.path().join(".simpliguard-folder.tmp")).expect("makes");
        remove_stale_temporaries(dir.path());
        assert!(!dir.path().join(".simpliguard-a1B2c3.tmp").exists());
        assert_eq!(fs::read_dir(dir.path()).expect("lists").count(), 5);
        // What this program writes has such a name.
        let file = temporary_in(dir.path()).expect("creates");
        assert!(is_generated(file.path().file_name().expect("has a name")));
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_the_umask_allows() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().expect("tempdir");
        write_atomic(&dir.path().join("ours"), b"", Durability::Process).expect("writes");
        fs::write(dir.path().join("plain"), b"").expect("writes");
        let mode = |name| fs::metadata(dir.path().join(name)).expect("exists").permissions().mode();
        assert_eq!(mode("ours"), mode("plain"));
    }
}
