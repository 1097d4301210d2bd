//! Faces of a level that stand for inverted surfaces of the source.

use super::texel_map::TexelMap;
use crate::data::LevelMesh;
use crate::render::SurfaceSample;

/// For each face, if most of its texels show inverted surfaces of the source ([`SurfaceSample::is_inverted`]). Only double-sided
/// faces can be: others are not seen from behind. `samples` has one entry a texel.
pub fn inverted_faces(texels: &TexelMap, samples: &[Option<SurfaceSample>], double_sided: &[bool]) -> Vec<bool> {
    let mut votes = vec![0i64; double_sided.len()];
    for (texel, sample) in texels.texels.iter().zip(samples) {
        if let (Some(texel), Some(sample)) = (texel, sample.filter(SurfaceSample::is_seen)) {
            votes[texel.triangle as usize] += if sample.is_inverted { 1 } else { -1 };
        }
    }
    votes.into_iter().zip(double_sided).map(|(votes, double_sided)| *double_sided && votes > 0).collect()
}

/// Turns the normals of the inverted faces to their backs, as those of the source are. Engines turn a normal around where they
/// see the back of a face, so they light such a surface from behind on either side. The tangents turn too, so that the normal map
/// stays as it is.
///
/// `inverted` has one entry a face. No vertex has faces of both kinds ([`super::level_mesh`]).
pub fn turn_inverted(mesh: &mut LevelMesh, inverted: &[bool]) {
    let mut sign = vec![1.0; mesh.positions.len()];
    for (triangle, _) in mesh.triangles.iter().zip(inverted).filter(|(_, inverted)| **inverted) {
        triangle.iter().for_each(|&v| sign[v as usize] = -1.0);
    }
    mesh.normals.iter_mut().zip(&sign).for_each(|(normal, sign)| *normal *= *sign);
    mesh.tangents.iter_mut().zip(&sign).for_each(|(tangent, sign)| *tangent *= *sign);
    for morph in &mut mesh.morphs {
        morph.normals.iter_mut().zip(&sign).for_each(|(change, sign)| *change *= *sign);
    }
}
