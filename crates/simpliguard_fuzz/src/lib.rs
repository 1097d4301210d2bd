//! What the fuzz targets of `tests/fuzz` run: whatever the bytes are, each body returns, and what it returns is sound.
//!
//! The tests of this crate run each body over the corpus of its target, so a finding stays found without a fuzzer.

mod compressed;
mod import;
mod mesh;
mod settings;
mod stored;

pub use compressed::compressed;
pub use import::import;
pub use mesh::{collapse, unwrap};
pub use settings::settings;
pub use stored::stored;

/// Each target by its name.
pub const TARGETS: [(&str, fn(&[u8])); 6] = [
    ("import", import),
    ("compressed", compressed),
    ("settings", settings),
    ("stored", stored),
    ("collapse", collapse),
    ("unwrap", unwrap),
];
