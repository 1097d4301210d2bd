//! The triangles of a source model.

use glam::{Vec2, Vec3, Vec4};

use super::{Influences, Morphs};

/// Smallest [`Surface::extent`] that levels are made for, in metres. Below it the squares of areas leave the range of
/// `f32`.
pub const SMALLEST_EXTENT: f32 = 1e-6;

/// A triangle soup in world space: metres, right-handed, y up, counter-clockwise faces seen from outside.
///
/// All per-vertex arrays have the length of `positions`, except those that are said to be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Rest pose, world space.
    pub positions: Vec<Vec3>,
    /// Unit length; area-weighted face normals where the source has none.
    pub normals: Vec<Vec3>,
    /// MikkTSpace tangent, with the handedness in `w`; zero where the source has none. Empty if no vertex has one.
    pub tangents: Vec<Vec4>,
    /// `TEXCOORD_0` and `TEXCOORD_1`, untransformed, origin at the top left; zero where missing. The second is empty
    /// if no material uses it.
    pub uvs: [Vec<Vec2>; 2],
    /// `COLOR_0`, linear RGBA; one where missing. Empty if no vertex has one.
    pub colors: Vec<Vec4>,
    /// Red of `COLOR_1`, 0 to 1; zero where missing. Empty if no vertex has one.
    pub painted: Vec<f32>,
    /// Bones of each vertex; empty if [`Model::rig`](super::Model::rig) is `None`.
    pub influences: Vec<Influences>,
    /// Vertex indices; no degenerate triangle and no exact duplicate.
    pub triangles: Vec<[u32; 3]>,
    /// Material of each triangle.
    pub material: Vec<u32>,
    /// The morph targets that the levels take over, if there are any.
    pub morphs: Option<Morphs>,
}

impl Surface {
    /// Longest side of the bounding box of all faces with finite corners, in metres; 0 without such faces.
    pub fn extent(&self) -> f32 {
        let mut bounds: Option<(Vec3, Vec3)> = None;
        for triangle in &self.triangles {
            let corners = triangle.map(|vertex| self.positions[vertex as usize]);
            if corners.iter().all(|p| p.is_finite()) {
                for p in corners {
                    let (low, high) = bounds.unwrap_or((p, p));
                    bounds = Some((low.min(p), high.max(p)));
                }
            }
        }
        bounds.map_or(0.0, |(low, high)| (high - low).max_element())
    }
}
