//! Weights of faces by their visible size: for quadrics and for texels.

use super::visibility::visible_pixels;
use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::BoundingSphere;

/// Directions of the views that decide on the density of texels.
const DENSITY_DIRECTIONS: usize = 36;
/// Density of texels on faces that hardly any view sees.
const LEAST_DENSITY: f32 = 0.5;
/// Density of texels on faces that all views see.
const LARGEST_DENSITY: f32 = 1.5;

/// Area of each face.
pub(super) fn face_areas(mesh: &TriMesh) -> Vec<f64> {
    (0..mesh.triangles.len()).map(|t| 0.5 * f64::from(mesh.area_vector(t).length())).collect()
}

/// Area of each face, scaled by the number of visible pixels per area around it, relative to the mean. `visible` is the
/// fraction of the weight that is scaled, 0 to 1.
pub(super) fn face_weights(mesh: &TriMesh, pixels: &[u32], visible: f64) -> Vec<f64> {
    let areas = face_areas(mesh);
    let area: f64 = areas.iter().sum();
    let total: f64 = pixels.iter().map(|&n| f64::from(n)).sum();
    if total == 0.0 || area == 0.0 {
        return areas;
    }
    // Pixels and area are summed around vertices: a face between two pixels gets a weight, too.
    let mut around = vec![(0.0, 0.0); mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for &v in triangle {
            around[v as usize].0 += f64::from(pixels[t]) / total;
            around[v as usize].1 += areas[t] / area;
        }
    }
    let density = |v: u32| around[v as usize].0 / around[v as usize].1.max(1e-12);
    let mean = |t: &[u32; 3]| t.iter().map(|&v| density(v)).sum::<f64>() / 3.0;
    mesh.triangles.iter().zip(&areas).map(|(t, &a)| a * ((1.0 - visible) + visible * mean(t))).collect()
}

/// Density of texels for each face, relative to the mean: the square root of the fraction of the face's area that
/// cameras around the mesh see, averaged with its neighbours.
pub fn texel_density(
    mesh: &TriMesh,
    sphere: &BoundingSphere,
    double_sided: bool,
    cancellation: &Cancellation,
) -> Vec<f32> {
    let pixels = visible_pixels(mesh, sphere, DENSITY_DIRECTIONS, &|_| double_sided, cancellation).covered;
    let weights = face_weights(mesh, &pixels, 1.0);
    let density = |(weight, area): (f64, f64)| {
        let density = if area > 0.0 { (weight / area).sqrt() as f32 } else { 1.0 };
        density.clamp(LEAST_DENSITY, LARGEST_DENSITY)
    };
    weights.into_iter().zip(face_areas(mesh)).map(density).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::simplify::visibility::tests::nested;

    #[test]
    fn hidden_faces_get_fewer_texels() {
        let mesh = nested();
        let density = texel_density(&mesh, &BoundingSphere::around(&mesh.positions), false, &Cancellation::default());
        assert_eq!(density[..4], [LEAST_DENSITY; 4]);
        assert!(density[4..].iter().all(|&d| (0.9..1.2).contains(&d)), "{density:?}");
        let nothing = TriMesh { positions: mesh.positions, triangles: vec![[0, 0, 0]] };
        assert_eq!(
            texel_density(&nothing, &BoundingSphere::around(&[Vec3::ZERO]), true, &Cancellation::default()),
            [1.0]
        );
    }
}
