//! Texture coordinates of a level.
use glam::Vec2;
/// A
#[derive(Clone, Debug, Default)]
pub struct Atlas {
    /// uv
    pub uvs: Vec<[Vec2; 3]>,
    /// c
    pub chart: Vec<u32>,
}
