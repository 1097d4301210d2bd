//! Encoding of colours and normals as bytes.

use glam::{Mat3, Vec3, Vec4Swizzles};

use super::texel_map::Texel;
use crate::data::LevelMesh;

/// A world-space normal in the tangent space of the level, as 0 to 1. A texel that no face covers gets a flat one.
pub(super) fn encode_normal(mesh: &LevelMesh, texel: Option<Texel>, normal: Vec3) -> Vec3 {
    let Some(texel) = texel else { return Vec3::new(0.5, 0.5, 1.0) };
    let n = texel.interpolate(&mesh.triangles, &mesh.normals).normalize_or(Vec3::Y);
    let t = texel.interpolate(&mesh.triangles, &mesh.tangents).xyz().normalize_or(n.any_orthonormal_vector());
    let [first, ..] = mesh.triangles[texel.triangle as usize];
    let handedness = mesh.tangents[first as usize].w;
    let bitangent = n.cross(t) * handedness;
    // A surface met from behind shows its back.
    let normal = if normal.dot(n) < 0.0 { -normal } else { normal };
    // The tangent frame of a low-poly mesh is not orthogonal: solve for the coordinates that shading will undo.
    let frame = Mat3::from_cols(t, bitangent, n);
    let local = if frame.determinant().abs() > 1e-3 { frame.inverse() * normal } else { frame.transpose() * normal };
    local.normalize_or(Vec3::Z) * 0.5 + 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_encode_to_blue_and_leaning_ones_towards_red_and_green() {
        let level = crate::texture::tests::level_mesh();
        let texel = Some(Texel { triangle: 0, barycentric: Vec3::splat(1.0 / 3.0) });
        let encoded = |n: Vec3| encode_normal(&level, texel, n.normalize());
        assert!((encoded(Vec3::Z) - Vec3::new(0.5, 0.5, 1.0)).length() < 1e-5);
        let leaning = encoded(Vec3::new(1.0, 1.0, 1.0));
        assert!(leaning.x > 0.7 && leaning.y > 0.7, "{leaning}");
    }
}
