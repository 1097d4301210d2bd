//! Differentiable rendering.
