//! Errors of the storage.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

/// An operation that the storage could not do. It is never a reason to stop a bake.
#[derive(Debug, thiserror::Error)]
pub enum StorageError {
    /// The file system refused.
    #[error("cache: cannot {action} {}: {source}", path.display())]
    Io {
        /// The operation, such as `read`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// The place of the cache's files holds something that this program has not made.
    #[error("cache: {} is not used: {found}; delete or rename it, or choose another folder for the cache", path.display())]
    Foreign {
        /// The file or folder.
        path: PathBuf,
        /// The content that was found.
        found: String,
    },
    /// A file does not hold the bytes that were stored.
    #[error("cache: {} {reason}; {}", path.display(), if *moved { "moved to quarantine" } else { "it could not be moved away" })]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The damage.
        reason: String,
        /// True if the file is in quarantine now.
        moved: bool,
    },
    /// The shared tier failed.
    #[error(
        "shared cache: cannot {action} {address}: {reason}; results stay on this machine: check the address and your rights there"
    )]
    Shared {
        /// The operation, such as `read from`.
        action: &'static str,
        /// The address of the tier.
        address: String,
        /// The reason.
        reason: String,
    },
    /// The shared tier has not answered for much longer than before. It is left alone for a while.
    #[error(
        "shared cache: {address} has not answered for {:.1} seconds; results stay on this machine meanwhile: check the \
         connection",
        time.as_secs_f32()
    )]
    Silent {
        /// The address of the tier.
        address: String,
        /// The time that was waited.
        time: Duration,
    },
    /// The shared tier did not answer in time. It is left alone from then on.
    #[error(
        "shared cache: {address} has not answered for {} seconds and is not asked again in this run; results stay on this \
         machine: check the connection",
        time.as_secs_f32()
    )]
    Stalled {
        /// The address of the tier.
        address: String,
        /// The time that was waited.
        time: Duration,
    },
    /// The shared tier cannot be used as it is configured.
    #[error("shared cache: {address} cannot be used: {reason}; mend the address or your credentials, or omit it")]
    Misconfigured {
        /// The address of the tier.
        address: String,
        /// The reason.
        reason: String,
    },
    /// The rights do not suffice to store results in the shared tier.
    #[error("shared cache: {address} is read, but not written: {reason}; new results stay on this machine")]
    ReadOnly {
        /// The address of the tier.
        address: String,
        /// The reason.
        reason: String,
    },
    /// A result of the shared tier has no valid signature of a trusted key.
    #[error(
        "shared cache: {address} has results without a valid signature of a trusted key; they are not used, and counted \
         as untrusted"
    )]
    Untrusted {
        /// The address of the tier.
        address: String,
    },
}
