//! Times that several files agree on.

use std::time::Duration;

/// Time without a change after which a file counts as written.
pub(super) const QUIET: Duration = Duration::from_millis(200);
/// Longest wait for a file that never stops changing.
pub(super) const PATIENCE: Duration = Duration::from_secs(10);
/// Time between two checks of a condition that is waited for.
pub(super) const TICK: Duration = Duration::from_millis(25);
