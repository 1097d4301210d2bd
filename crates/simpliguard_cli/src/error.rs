//! Requests that cannot be carried out.

/// A request that cannot be carried out as it stands. Nothing was baked.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct UsageError(pub(crate) String);

impl From<simpliguard::Error> for UsageError {
    fn from(error: simpliguard::Error) -> Self {
        Self(error.to_string())
    }
}

impl From<simpliguard_eval::LpipsError> for UsageError {
    fn from(error: simpliguard_eval::LpipsError) -> Self {
        Self(error.to_string())
    }
}
