//! Pictures and figures of baked levels beside their source.

mod sheet;
pub mod stress;

pub use sheet::contact_sheet;
