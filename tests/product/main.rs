//! Tests of the product as a whole: what the repository ships besides code agrees with the code.

mod appearance;
mod arrival;
mod assets;
mod bake;
mod bevy_cli;
mod blocks;
mod crowd;
mod docs;
mod objects;
mod on_demand;
mod plugin;
mod pops;
mod reduction;
mod scene;
mod tree;
mod village;
