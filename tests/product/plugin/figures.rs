//! Times of a running game, printed: `cargo test --test product -- --ignored --nocapture figures`.
