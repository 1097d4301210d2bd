//! Meshes in the unit sphere, where quadrics keep their precision.

use crate::data::TriMesh;
use crate::geometry::BoundingSphere;

/// `mesh`, moved and scaled so that `sphere` becomes the unit sphere around the origin.
pub(super) fn to_unit_sphere(mesh: &TriMesh, sphere: &BoundingSphere) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| (*p - sphere.centre) / sphere.radius).collect();
    TriMesh { positions, triangles: mesh.triangles.clone() }
}

/// The inverse of [`to_unit_sphere`].
pub(super) fn from_unit_sphere(mesh: TriMesh, sphere: &BoundingSphere) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| *p * sphere.radius + sphere.centre).collect();
    TriMesh { positions, triangles: mesh.triangles }
}
