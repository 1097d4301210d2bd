//! A game with the plugin, from outside: each test has a folder of its own and starts the game in a process.

mod app;
mod bakes;
mod model;
mod project;
mod scenes;
mod switching;
