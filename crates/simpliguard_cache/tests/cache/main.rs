//! The cache as its users see it.

mod folder;
mod limits;
mod store;
mod trouble;
