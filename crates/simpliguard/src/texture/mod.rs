//! Level textures.
