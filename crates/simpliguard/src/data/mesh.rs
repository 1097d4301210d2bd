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
    /// Appends the vertices and triangles of another mesh.
    pub fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|v| v + first)));
    }

    /// The corners of triangle `t`.
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.positions[v as usize])
    }

    /// Twice the area of triangle `t` times its unit normal.
    pub fn area_vector(&self, t: usize) -> Vec3 {
        area_vector(self.corners(t))
    }

    /// The area of all triangles.
    pub fn area(&self) -> f32 {
        (0..self.triangles.len()).map(|t| 0.5 * self.area_vector(t).length()).sum()
    }

    /// The triangles for which `keep` returns true. Vertices are renumbered in order of first use.
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

    /// Unit vertex normals: face normals weighted by corner angle; `+y` for a vertex without area.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                normals[triangle[k] as usize] += self.corner_normal(t, k);
            }
        }
        normals.into_iter().map(|n| n.normalize_or(Vec3::Y)).collect()
    }

    /// Unit normal of face `t` times its angle at corner `k`, in radians.
    pub fn corner_normal(&self, t: usize, k: usize) -> Vec3 {
        let corners = self.corners(t);
        let ab = (corners[(k + 1) % 3] - corners[k]).normalize_or_zero();
        let ac = (corners[(k + 2) % 3] - corners[k]).normalize_or_zero();
        self.area_vector(t).normalize_or_zero() * libm::acosf(ab.dot(ac).clamp(-1.0, 1.0))
    }

    /// Lower and upper corner of the bounding box; both zero for an empty mesh.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        bounds(&self.positions)
    }

    /// Checks that every triangle refers to vertices that exist, and that every position is finite.
    ///
    /// # Errors
    /// The first broken rule, with the triangle or the vertex.
    pub fn validate(&self) -> Result<(), String> {
        check_indices(&self.triangles, self.positions.len())?;
        check_finite("position", &self.positions, |p| p.is_finite())
    }
}

/// Twice the area of a triangle times its unit normal.
pub fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Lower and upper corner of the box around `positions`; both zero if there are none.
pub fn bounds(positions: &[Vec3]) -> (Vec3, Vec3) {
    let Some(&first) = positions.first() else { return (Vec3::ZERO, Vec3::ZERO) };
    positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)))
}

/// `Err` if a triangle refers to a vertex at or above `vertices`.
pub(super) fn check_indices(triangles: &[[u32; 3]], vertices: usize) -> Result<(), String> {
    match triangles.iter().position(|triangle| triangle.iter().any(|&v| v as usize >= vertices)) {
        Some(t) => Err(format!("triangle {t} refers to the vertices {:?} of {vertices}", triangles[t])),
        None => Ok(()),
    }
}

/// `Err` if `is_finite` does not hold for a vertex's value; `name` says what the values are.
pub(super) fn check_finite<T>(name: &str, values: &[T], is_finite: impl Fn(&T) -> bool) -> Result<(), String> {
    match values.iter().position(|value| !is_finite(value)) {
        Some(v) => Err(format!("the {name} of vertex {v} is not finite")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> TriMesh {
        TriMesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]] }
    }

    #[test]
    fn a_sound_mesh_passes() {
        assert_eq!(triangle().validate(), Ok(()));
        assert_eq!(TriMesh::default().validate(), Ok(()));
    }

    #[test]
    fn each_broken_rule_is_named() {
        let mut outside = triangle();
        outside.triangles.push([0, 1, 3]);
        assert_eq!(outside.validate().expect_err("broken"), "triangle 1 refers to the vertices [0, 1, 3] of 3");
        for poison in [f32::NAN, f32::INFINITY] {
            let mut poisoned = triangle();
            poisoned.positions[2].y = poison;
            assert_eq!(poisoned.validate().expect_err("broken"), "the position of vertex 2 is not finite");
        }
    }

    #[test]
    fn the_area_vector_is_twice_the_area_along_the_normal() {
        assert_eq!(triangle().area_vector(0), Vec3::Z);
        assert_eq!(area_vector([Vec3::ZERO, Vec3::Y * 3.0, Vec3::X]), Vec3::Z * -3.0);
    }
}
