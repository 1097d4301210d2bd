//! The triangles of a source model.

use glam::{Vec2, Vec3, Vec4};

use super::{Influences, MorphTarget, Morphs};

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
    /// Unit length; those of the faces where the source has none.
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

    /// The triangles with these indices, in their order, and only the vertices that they use.
    pub fn subset(&self, triangles: &[u32]) -> Self {
        const UNUSED: u32 = u32::MAX;
        let mut new_index = vec![UNUSED; self.positions.len()];
        let corners = |&t: &u32| self.triangles[t as usize];
        triangles.iter().flat_map(corners).for_each(|v| new_index[v as usize] = 0);
        let kept: Vec<u32> = (0..new_index.len() as u32).filter(|&v| new_index[v as usize] != UNUSED).collect();
        kept.iter().zip(0..).for_each(|(&v, new)| new_index[v as usize] = new);
        let mut out = self.gathered(&kept);
        out.triangles = triangles.iter().map(|t| corners(t).map(|v| new_index[v as usize])).collect();
        out.material = triangles.iter().map(|&t| self.material[t as usize]).collect();
        out
    }

    /// The vertices with the indices `kept`, in that order and without triangles. An index may stand more than once.
    pub(crate) fn gathered(&self, kept: &[u32]) -> Self {
        let target = |target: &MorphTarget| {
            let moved = (0..).zip(kept).map(|(new, &v)| (new, target.displacement(v)));
            MorphTarget { displacements: moved.filter(|(_, offset)| *offset != Vec3::ZERO).collect(), ..target.clone() }
        };
        Self {
            positions: gather(&self.positions, kept),
            normals: gather(&self.normals, kept),
            tangents: gather(&self.tangents, kept),
            uvs: [gather(&self.uvs[0], kept), gather(&self.uvs[1], kept)],
            colors: gather(&self.colors, kept),
            painted: gather(&self.painted, kept),
            influences: gather(&self.influences, kept),
            triangles: Vec::new(),
            material: Vec::new(),
            morphs: self
                .morphs
                .as_ref()
                .map(|morphs| Morphs { node: morphs.node, targets: morphs.targets.iter().map(target).collect() }),
        }
    }
}

/// The elements of a per-vertex array with the indices `kept`; an empty array stays empty.
pub(crate) fn gather<T: Copy>(all: &[T], kept: &[u32]) -> Vec<T> {
    if all.is_empty() { Vec::new() } else { kept.iter().map(|&v| all[v as usize]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_subset_keeps_only_what_its_triangles_use() {
        let displacements = vec![(0, Vec3::X), (3, Vec3::Y)];
        let surface = Surface {
            positions: (0..4).map(|i| Vec3::splat(i as f32)).collect(),
            normals: vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X],
            painted: vec![0.0, 0.1, 0.2, 0.3],
            triangles: vec![[0, 1, 2], [3, 2, 1]],
            material: vec![5, 6],
            morphs: Some(Morphs { node: 7, targets: vec![MorphTarget { displacements, ..MorphTarget::default() }] }),
            ..Surface::default()
        };
        let subset = surface.subset(&[1]);
        assert_eq!(subset.positions, [1.0, 2.0, 3.0].map(Vec3::splat));
        assert_eq!(subset.normals, [Vec3::Y, Vec3::Z, Vec3::NEG_X]);
        assert_eq!((subset.painted.as_slice(), subset.colors.len()), ([0.1, 0.2, 0.3].as_slice(), 0));
        assert_eq!((subset.triangles, subset.material), (vec![[2, 1, 0]], vec![6]));
        let morphs = subset.morphs.expect("morph targets");
        assert_eq!((morphs.node, morphs.targets[0].displacements.as_slice()), (7, [(2, Vec3::Y)].as_slice()));
    }
}
