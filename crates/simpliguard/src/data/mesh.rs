//! Plain triangle meshes, as the geometric stages pass them on.

use glam::Vec3;

/// Indexed triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// The corners of triangle `t`.
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.positions[v as usize])
    }

    /// Twice the area of triangle `t` times its unit normal.
    pub fn area_vector(&self, t: usize) -> Vec3 {
        area_vector(self.corners(t))
    }

    /// The triangles that `keep` holds true for, vertices renumbered in order of first use.
    pub fn filtered(&self, mut keep: impl FnMut(usize) -> bool) -> Self {
        let mut renumbered = vec![u32::MAX; self.positions.len()];
        let mut out = Self::default();
        for (t, triangle) in self.triangles.iter().enumerate() {
            if !keep(t) {
                continue;
            }
            out.triangles.push(triangle.map(|v| {
                let slot = &mut renumbered[v as usize];
                if *slot == u32::MAX {
                    *slot = out.positions.len() as u32;
                    out.positions.push(self.positions[v as usize]);
                }
                *slot
            }));
        }
        out
    }

    /// Unit vertex normals, face normals weighted by corner angle; y for a vertex without area.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            let normal = self.area_vector(t).normalize_or_zero();
            let corners = self.corners(t);
            for k in 0..3 {
                let ab = (corners[(k + 1) % 3] - corners[k]).normalize_or_zero();
                let ac = (corners[(k + 2) % 3] - corners[k]).normalize_or_zero();
                normals[triangle[k] as usize] += normal * libm::acosf(ab.dot(ac).clamp(-1.0, 1.0));
            }
        }
        normals.into_iter().map(|n| n.normalize_or(Vec3::Y)).collect()
    }

    /// Lower and upper corner of the bounding box; both zero for an empty mesh.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        bounds(&self.positions)
    }
}

/// Twice the area of a triangle times its unit normal.
#[inline]
pub fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Lower and upper corner of the box around `positions`; both zero if there are none.
pub fn bounds(positions: &[Vec3]) -> (Vec3, Vec3) {
    let Some(&first) = positions.first() else { return (Vec3::ZERO, Vec3::ZERO) };
    positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)))
}
