//! Texture coordinates of a level.
