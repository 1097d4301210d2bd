//! Pictures and metrics of baked levels.
