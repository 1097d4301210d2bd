//! Bounded reads: of regular files only, and of no more bytes than a limit.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use crate::retry::Backoff;

/// Reads a regular file of at most `most` bytes. Symbolic links are followed. If another program has the file open, tries
/// again for a short time.
///
/// # Errors
/// [`ErrorKind::InvalidInput`] if the path is a pipe, a device or a folder, which could be read for ever;
/// [`ErrorKind::FileTooLarge`] over the limit; otherwise those of the file system.
pub fn read_bounded(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    Backoff::for_reading().retry(|| read_once(path, most))
}

fn read_once(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open_regular(path)?;
    let size = checked_size(&file.metadata()?, most)?;
    let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
    // The file may grow meanwhile, and some files are longer than they say.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(too_large(bytes.len() as u64, most)) } else { Ok(bytes) }
}

/// Opens a regular file for reading.
pub(crate) fn open_regular(path: &Path) -> io::Result<File> {
    // Opening a device may do something already.
    checked_size(&fs::metadata(path)?, u64::MAX)?;
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        // If a pipe takes the place of the file now, opening it does not wait for a writer.
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags(libc::O_NONBLOCK);
    }
    let file = options.open(path)?;
    checked_size(&file.metadata()?, u64::MAX)?;
    Ok(file)
}

fn checked_size(data: &Metadata, most: u64) -> io::Result<u64> {
    if !data.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is not a regular file"));
    }
    if data.len() > most { Err(too_large(data.len(), most)) } else { Ok(data.len()) }
}

fn too_large(size: u64, most: u64) -> io::Error {
    let found = format!("it has at least {size} bytes, over the limit of {most}");
    io::Error::new(ErrorKind::FileTooLarge, found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_up_to_the_limit() {
        let dir = tempfile::tempdir().expect("tempdir");
        let path = dir.path().join("file");
        fs::write(&path, b"12345").expect("writes");
        assert_eq!(read_bounded(&path, 5).expect("reads"), b"12345");
        let error = read_bounded(&path, 4).expect_err("too large");
        assert_eq!(error.to_string(), "it has at least 5 bytes, over the limit of 4");
        assert_eq!(read_bounded(&dir.path().join("none"), 9).expect_err("missing").kind(), ErrorKind::NotFound);
        assert_eq!(read_bounded(dir.path(), 9).expect_err("a folder").kind(), ErrorKind::InvalidInput);
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_at_once() {
        let dir = tempfile::tempdir().expect("tempdir");
        let (pipe, zeros) = (dir.path().join("pipe"), dir.path().join("zeros"));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("runs").success());
        std::os::unix::fs::symlink("/dev/zero", &zeros).expect("links");
        for special in [pipe, zeros] {
            let error = read_bounded(&special, u64::MAX).expect_err("special");
            assert_eq!(error.to_string(), "it is not a regular file");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn files_that_are_longer_than_they_say_end_at_the_limit() {
        // The size of this file is given as zero.
        let error = read_bounded(Path::new("/proc/self/maps"), 16).expect_err("longer");
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
    }
}
