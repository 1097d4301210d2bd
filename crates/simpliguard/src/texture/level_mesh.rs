//! From the welded mesh to the mesh of a level, whose vertices are split along chart borders.

use std::collections::HashMap;

use glam::Vec3;

use crate::data::{Atlas, Influences, LevelMesh, LevelMorph, TriMesh};

/// Splits vertices along chart borders, and between faces that are inverted and others. The level has no tangents yet
/// ([`super::tangents`]).
///
/// `normals` has one entry for each corner of each face, equal within a chart at a vertex ([`super::corner_normals`]);
/// `inverted` has one entry a face ([`super::inverted_faces`]);
/// `influences` has one entry a vertex of `mesh`, or none; `morphs` one a morph target, each with one entry a vertex.
pub fn level_mesh(
    (mesh, atlas): (&TriMesh, &Atlas),
    normals: &[[Vec3; 3]],
    inverted: &[bool],
    influences: &[Influences],
    morphs: &[LevelMorph],
) -> LevelMesh {
    let mut out = LevelMesh { morphs: vec![LevelMorph::default(); morphs.len()], ..LevelMesh::default() };
    let mut ids: HashMap<(u32, [u32; 2], bool), u32> = HashMap::new();
    let faces = mesh.triangles.iter().zip(&atlas.uvs).zip(normals).zip(inverted);
    for (((triangle, uvs), normals), inverted) in faces {
        let mut corners = [0; 3];
        for k in 0..3 {
            let (v, uv) = (triangle[k], uvs[k]);
            corners[k] = *ids.entry((v, [uv.x.to_bits(), uv.y.to_bits()], *inverted)).or_insert_with(|| {
                out.positions.push(mesh.positions[v as usize]);
                out.normals.push(normals[k]);
                out.uvs.push(uv);
                out.influences.extend(influences.get(v as usize));
                for (out, morph) in out.morphs.iter_mut().zip(morphs) {
                    out.positions.push(morph.positions[v as usize]);
                    out.normals.push(morph.normals[v as usize]);
                }
                out.positions.len() as u32 - 1
            });
        }
        out.triangles.push(corners);
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::texture::tests::level as square;
    use crate::texture::{tangents, turn_inverted};

    #[test]
    fn an_upright_image_has_its_tangent_along_u_and_positive_handedness() {
        let (mesh, atlas) = square();
        let level = level_mesh((&mesh, &atlas), &[[Vec3::Z; 3]; 2], &[false; 2], &[], &[]);
        assert_eq!(level.positions.len(), 4);
        assert!(tangents(&level).iter().all(|t| (*t - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6));
    }

    #[test]
    fn a_vertex_on_a_chart_border_is_split() {
        let (mesh, mut atlas) = square();
        atlas.uvs[1] = atlas.uvs[1].map(|uv| uv * 0.5);
        assert_eq!(level_mesh((&mesh, &atlas), &[[Vec3::Z; 3]; 2], &[false; 2], &[], &[]).positions.len(), 6);
    }

    #[test]
    fn a_vertex_between_an_inverted_face_and_another_is_split() {
        let (mesh, atlas) = square();
        let mut level = level_mesh((&mesh, &atlas), &[[Vec3::Z; 3]; 2], &[false, true], &[], &[]);
        level.tangents = tangents(&level);
        assert_eq!(level.positions.len(), 6);
        turn_inverted(&mut level, &[false, true]);
        let at = |t: usize| level.triangles[t].map(|v| (level.normals[v as usize], level.tangents[v as usize]));
        let along_u = Vec4::new(1.0, 0.0, 0.0, 1.0);
        assert_eq!(at(0), [(Vec3::Z, along_u); 3]);
        assert_eq!(at(1), [(-Vec3::Z, -along_u); 3]);
    }
}
