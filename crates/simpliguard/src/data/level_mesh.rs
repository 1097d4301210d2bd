//! The vertices and triangles of a level.

use glam::{Vec2, Vec3, Vec4};

use super::Influences;
use super::atlas::in_unit_square;
use super::mesh::{check_finite, check_indices};

/// Largest distance of a unit normal's length from one: far above rounding, far below a visible change.
const LENGTH_TOLERANCE: f32 = 1e-3;

/// Triangles of a level. Vertices are duplicated along chart borders. Rest pose, world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelMesh {
    /// World space.
    pub positions: Vec<Vec3>,
    /// Unit length.
    pub normals: Vec<Vec3>,
    /// MikkTSpace; empty if the level has no normal map.
    pub tangents: Vec<Vec4>,
    /// Origin at the top left; in [0, 1] unless the level keeps the source's materials.
    pub uvs: Vec<Vec2>,
    /// The source's second set of texture coordinates; empty for a level with an atlas of its own.
    pub second_uvs: Vec<Vec2>,
    /// The source's vertex colours, linear RGBA; empty for a level with textures of its own.
    pub colors: Vec<Vec4>,
    /// Bones of each vertex; empty for a static model.
    pub influences: Vec<Influences>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// One for each of the source's [`MorphTarget`](super::MorphTarget)s, or none.
    pub morphs: Vec<LevelMorph>,
}

/// The effect of a morph target on each vertex of a level, at a weight of one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelMorph {
    /// Displacements in world space at rest, in metres.
    pub positions: Vec<Vec3>,
    /// Changes of the normals.
    pub normals: Vec<Vec3>,
}

impl LevelMesh {
    /// Checks array lengths, indices, finite values, normals of unit length within 1e-3, and the [`Influences`] of every
    /// vertex.
    ///
    /// # Errors
    /// The first broken rule, with the values found.
    pub fn validate(&self) -> Result<(), String> {
        self.check_arrays()?;
        for (k, morph) in self.morphs.iter().enumerate() {
            check_finite(&format!("displacement by morph target {k}"), &morph.positions, |p| p.is_finite())?;
            check_finite(&format!("normal of morph target {k}"), &morph.normals, |n| n.is_finite())?;
        }
        let is_unit = |n: &Vec3| (n.length() - 1.0).abs() <= LENGTH_TOLERANCE;
        if let Some(v) = self.normals.iter().position(|n| !is_unit(n)) {
            return Err(format!("the normal of vertex {v} has the length {}", self.normals[v].length()));
        }
        for (v, influences) in self.influences.iter().enumerate() {
            influences.validate().map_err(|found| format!("vertex {v}: {found}"))?;
        }
        Ok(())
    }

    /// Checks that the texture coordinates of triangles lie in `[0, 1]`, as those of an atlas do.
    ///
    /// # Errors
    /// The vertex and its texture coordinate.
    pub fn validate_atlas(&self, triangles: &[[u32; 3]]) -> Result<(), String> {
        let corner = |v: u32| self.uvs.get(v as usize).map(|uv| (v, *uv));
        let mut corners = triangles.as_flattened().iter().filter_map(|v| corner(*v));
        match corners.find(|(_, uv)| !in_unit_square(*uv)) {
            Some((v, uv)) => Err(format!("vertex {v} has the texture coordinate {uv} outside of [0, 1]")),
            None => Ok(()),
        }
    }

    /// Checks array lengths and indices, and that positions, normals, tangents and texture coordinates are finite: the
    /// rules without which the level cannot be written.
    pub(crate) fn check_arrays(&self) -> Result<(), String> {
        let vertices = self.positions.len();
        let mut lengths = vec![
            ("normals", self.normals.len(), false),
            ("texture coordinates", self.uvs.len(), false),
            ("second texture coordinates", self.second_uvs.len(), true),
            ("colours", self.colors.len(), true),
            ("tangents", self.tangents.len(), true),
            ("influences", self.influences.len(), true),
        ];
        for morph in &self.morphs {
            lengths.push(("displacements by a morph target", morph.positions.len(), false));
            lengths.push(("normals of a morph target", morph.normals.len(), false));
        }
        for (name, length, may_be_empty) in lengths {
            if length != vertices && !(may_be_empty && length == 0) {
                return Err(format!("the mesh has {length} {name} for {vertices} vertices"));
            }
        }
        check_indices(&self.triangles, vertices)?;
        check_finite("position", &self.positions, |p| p.is_finite())?;
        check_finite("normal", &self.normals, |n| n.is_finite())?;
        check_finite("tangent", &self.tangents, |t| t.is_finite())?;
        check_finite("colour", &self.colors, |c| c.is_finite())?;
        check_finite("second texture coordinate", &self.second_uvs, |uv| uv.is_finite())?;
        check_finite("texture coordinate", &self.uvs, |uv| uv.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle with every array filled.
    fn full() -> LevelMesh {
        LevelMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            tangents: vec![Vec3::X.extend(1.0); 3],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
            second_uvs: vec![Vec2::ZERO; 3],
            colors: vec![Vec4::ONE; 3],
            influences: vec![Influences::rigid(2); 3],
            triangles: vec![[0, 1, 2]],
            morphs: vec![LevelMorph { positions: vec![Vec3::Z; 3], normals: vec![Vec3::ZERO; 3] }],
        }
    }

    #[test]
    fn a_sound_mesh_passes_with_and_without_what_is_optional() {
        assert_eq!(full().validate(), Ok(()));
        let bare = LevelMesh {
            tangents: Vec::new(),
            second_uvs: Vec::new(),
            colors: Vec::new(),
            influences: Vec::new(),
            morphs: Vec::new(),
            ..full()
        };
        assert_eq!((bare.validate(), bare.validate_atlas(&bare.triangles)), (Ok(()), Ok(())));
    }

    #[test]
    fn each_broken_rule_is_named() {
        let message = |edit: &dyn Fn(&mut LevelMesh)| {
            let mut mesh = full();
            edit(&mut mesh);
            mesh.validate().expect_err("broken")
        };
        assert!(message(&|mesh| mesh.normals.clear()).contains("0 normals for 3 vertices"));
        assert!(message(&|mesh| mesh.uvs.truncate(2)).contains("2 texture coordinates"));
        assert!(message(&|mesh| mesh.tangents.truncate(1)).contains("1 tangents"));
        assert!(message(&|mesh| mesh.influences.truncate(1)).contains("1 influences"));
        assert!(message(&|mesh| mesh.morphs[0].positions.clear()).contains("0 displacements"));
        assert!(message(&|mesh| mesh.morphs[0].normals.clear()).contains("0 normals of a morph target"));
        assert!(message(&|mesh| mesh.triangles[0][2] = 3).contains("refers to the vertices [0, 1, 3] of 3"));
        assert!(message(&|mesh| mesh.positions[1].x = f32::NAN).contains("position of vertex 1"));
        assert!(message(&|mesh| mesh.tangents[1].w = f32::INFINITY).contains("tangent of vertex 1"));
        assert!(message(&|mesh| mesh.morphs[0].positions[1].x = f32::NAN).contains("by morph target 0 of vertex 1"));
        assert!(message(&|mesh| mesh.colors.truncate(1)).contains("1 colours"));
        assert!(message(&|mesh| mesh.second_uvs.truncate(2)).contains("2 second texture coordinates"));
        assert!(message(&|mesh| mesh.normals[2] = Vec3::Z * 1.01).contains("normal of vertex 2 has the length 1.01"));
        assert!(message(&|mesh| mesh.influences[1].weights[0] = 0.9).contains("vertex 1: weights"));
        let mut outside = full();
        outside.uvs[2].y = 1.5;
        assert!(outside.validate_atlas(&outside.triangles).expect_err("broken").contains("outside of [0, 1]"));
    }
}
