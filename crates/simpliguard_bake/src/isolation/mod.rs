//! Bakes in a process of their own, so that a crash or a lack of memory costs one model and not the program.
//!
//! The program starts itself once more for each bake. The child takes one request from its input, bakes, writes the parts of
//! the result to a folder of the parent, and ends. It also ends when the parent does, because its input ends then.
//!
//! ```text
//! parent                              child
//! Isolation::bake  -- request -->     serve
//!                  <- messages --
//!                  <-- files ----
//! ```

mod child;
mod messages;
mod parent;
mod request;
#[cfg(test)]
mod tests;

pub use child::{is_child, serve};
pub use parent::Isolation;
