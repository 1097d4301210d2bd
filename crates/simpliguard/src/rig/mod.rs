//! Skin influences of a level.
