//! The command as its users run it.

mod backend;
mod bake;
mod bench;
mod cache;
mod compare;
mod farm;
mod folder;
mod gate;
mod hostile;
mod inspect;
mod report;
mod scene;
mod together;
mod usage;
