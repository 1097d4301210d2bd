//! MikkTSpace tangents.

use glam::{Vec2, Vec4};

use crate::data::LevelMesh;

/// MikkTSpace tangents of a level. A vertex takes the tangent of the last of its corners; all are alike where charts are
/// split.
pub fn tangents(mesh: &LevelMesh) -> Vec<Vec4> {
    let mut geometry = Tangents { mesh, out: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); mesh.positions.len()] };
    // Fails only if a face has other than three or four corners, or there are more faces than 32 bits count.
    if let Err(error) = bevy_mikktspace::generate_tangents::<_, Portable>(&mut geometry) {
        tracing::warn!(?error, "tangents could not be generated; the level has default ones");
    }
    geometry.out
}

struct Tangents<'a> {
    mesh: &'a LevelMesh,
    out: Vec<Vec4>,
}

/// Functions that give the same last bit on every platform.
struct Portable;

impl bevy_mikktspace::Ops for Portable {
    fn sqrt(x: f32) -> f32 {
        x.sqrt()
    }

    fn acos(x: f32) -> f32 {
        libm::acos(f64::from(x)) as f32
    }
}

impl Tangents<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.triangles[face][corner] as usize
    }
}

impl bevy_mikktspace::Geometry<Portable> for Tangents<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.vertex(face, corner)].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        // MikkTSpace has v upwards, glTF downwards.
        let uv = self.mesh.uvs[self.vertex(face, corner)];
        Vec2::new(uv.x, 1.0 - uv.y).to_array()
    }

    fn set_tangent(&mut self, space: Option<bevy_mikktspace::TangentSpace>, face: usize, corner: usize) {
        let vertex = self.vertex(face, corner);
        if let Some(space) = space {
            self.out[vertex] = Vec4::from(space.tangent_encoded());
        }
    }
}
