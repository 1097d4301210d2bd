//! Atomic writes: a reader sees the whole file or no file.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// The beginning and the end of the names of temporary files.
const TEMPORARY: [&str; 2] = [".simpliguard-", ".tmp"];

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
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY[0]).suffix(TEMPORARY[1]);
    #[cfg(unix)]
    {
        // Temporary files are private by default. This one gets the permissions of any new file: those of the umask.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(scratch)?;
    file.write_all(bytes)?;
    if durability == Durability::PowerLoss {
        file.as_file().sync_all()?;
    }
    persist(file, path)
}

/// Tells whether a name is that of a temporary file of this program.
pub(crate) fn is_temporary(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(TEMPORARY[0].as_bytes()) && name.ends_with(TEMPORARY[1].as_bytes())
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

#[cfg(not(windows))]
fn persist(file: tempfile::NamedTempFile, path: &Path) -> io::Result<()> {
    file.persist(path).map(drop).map_err(|e| e.error)
}

/// Renames, with some retries: on Windows a rename fails while another process has the target open, often a virus
/// scanner.
#[cfg(windows)]
fn persist(mut file: tempfile::NamedTempFile, path: &Path) -> io::Result<()> {
    let mut wait = std::time::Duration::from_millis(5);
    loop {
        match file.persist(path) {
            Ok(_) => return Ok(()),
            Err(e) if e.error.kind() == io::ErrorKind::PermissionDenied && wait.as_millis() < 500 => {
                file = e.file;
                std::thread::sleep(wait);
                wait *= 2;
            }
            Err(e) => return Err(e.error),
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
