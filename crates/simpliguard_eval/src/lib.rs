//! Pictures and figures of baked levels beside their source.

pub mod compare;
mod encode;
mod lpips;
mod pictures;
mod sheet;
mod similarity;
pub mod stress;
mod turntable;

pub use encode::{at_most, encode, jpeg};
pub use lpips::{Lpips, LpipsError};
pub use pictures::{Pictures, pictures};
pub use sheet::{contact_sheet, side_by_side};
pub use similarity::{Similarity, similarity};
pub use turntable::{TurntableError, turntable};
