//! The cache as its users see it.

mod folder;
mod foreign;
mod limits;
mod shared;
mod store;
mod trouble;
