//! Bake settings.
