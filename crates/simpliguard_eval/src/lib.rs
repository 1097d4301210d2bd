//! Pictures of baked levels beside their source.

mod sheet;

pub use sheet::contact_sheet;
