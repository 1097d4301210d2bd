//! Watertight surface around a triangle soup.
