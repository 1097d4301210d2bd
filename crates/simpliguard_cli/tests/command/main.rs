//! The command as its users run it.

mod bake;
mod folder;
mod usage;
