//! Pictures and figures of baked levels beside their source.

mod sheet;
pub mod stress;
mod turntable;

pub use sheet::contact_sheet;
pub use turntable::{TurntableError, turntable};
