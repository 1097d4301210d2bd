//! Writing a file so that nobody ever sees half of it.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// How the names of temporary files begin and end.
const TEMPORARY: [&str; 2] = [".simpliguard-", ".tmp"];

/// What a file must outlive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// The end of the process.
    Process,
    /// A loss of power: the file is on the disk before it gets its name.
    PowerLoss,
}

/// Writes `bytes` to a temporary file in the folder of `path` and renames it to `path`. Makes the folder if need be. If
/// anything fails, `path` is as it was.
pub fn write_atomic(path: &Path, bytes: &[u8], durability: Durability) -> io::Result<()> {
    write_atomic_through(folder_of(path), path, bytes, durability)
}

/// As [`write_atomic`], with the temporary file in `scratch`, a folder on the same file system: for folders that somebody
/// watches.
pub fn write_atomic_through(scratch: &Path, path: &Path, bytes: &[u8], durability: Durability) -> io::Result<()> {
    fs::create_dir_all(folder_of(path))?;
    fs::create_dir_all(scratch)?;
    replace(scratch, path, bytes, durability)
}

/// As [`write_atomic_through`], but makes no folder.
pub(crate) fn replace(scratch: &Path, path: &Path, bytes: &[u8], durability: Durability) -> io::Result<()> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY[0]).suffix(TEMPORARY[1]);
    #[cfg(unix)]
    {
        // As any new file, by the user's umask; temporary files are private otherwise.
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

/// Whether a name is one of a temporary file of ours.
pub(crate) fn is_temporary(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(TEMPORARY[0].as_bytes()) && name.ends_with(TEMPORARY[1].as_bytes())
}

pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// `Err` with the reason if no file can be made in `folder`. Leaves nothing behind.
pub fn can_write_in(folder: &Path) -> io::Result<()> {
    tempfile::tempfile_in(folder).map(drop)
}

#[cfg(not(windows))]
fn persist(file: tempfile::NamedTempFile, path: &Path) -> io::Result<()> {
    file.persist(path).map(drop).map_err(|e| e.error)
}

/// A rename fails while another process, often a virus scanner, has the target open.
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
