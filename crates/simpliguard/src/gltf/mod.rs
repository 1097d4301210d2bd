//! glTF in and out.

mod import;

pub use import::{Limits, has_levels, import};
