//! `simpliguard cache keygen`: a new key for signatures of a shared cache.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

use simpliguard_cache::{PublicKey, SecretKey};

use crate::error::UsageError;

/// Writes a new secret key to a new file that only the user can read. Returns its public key.
pub(super) fn write(file: &Path) -> Result<PublicKey, UsageError> {
    let failed = |found: String| UsageError(format!("{}: {found}; choose a new file", file.display()));
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(|e| failed(format!("the system has no random numbers: {e}")))?;
    let secret = SecretKey::from_bytes(&bytes);
    let mut options = OpenOptions::new();
    // A key that is there may be in use.
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.mode(0o600);
    }
    let written = options.open(file).and_then(|mut file| file.write_all(format!("{}\n", secret.to_hex()).as_bytes()));
    written.map_err(|e| failed(format!("cannot write the key: {e}")))?;
    Ok(secret.public())
}
