//! A game with the plugin, from outside: each test has a folder of its own and starts the game in a process.

mod app;
mod bakes;
mod cache;
mod drawing;
mod figures;
mod many;
mod model;
mod project;
mod saves;
mod scenes;
mod second;
mod switching;
