//! The surface of a reduced mesh.

use std::collections::HashMap;

use glam::Vec3;

use super::attributes::Scales;
use super::wedges::{Wedge, WedgeMesh};
use crate::data::{AlphaMode, Model, Surface, TriMesh};
use crate::geometry::BoundingSphere;
use crate::simplify::weld::{self, COINCIDENT_OFFSET};

/// A vertex of the surface.
struct Vertex {
    wedge: u32,
    /// Of the manifold.
    point: u32,
    /// Of its faces, if they are flat.
    normal: Option<Vec3>,
}

/// The live faces of a mesh as a surface in world space, cut into a manifold.
pub(super) fn surface(model: &Model, mesh: &WedgeMesh, sphere: &BoundingSphere, scales: &Scales<'_>) -> Surface {
    let source = &model.surface;
    let faces = in_order(model, mesh);
    let position = |(point, &v): (usize, &u32)| match mesh.is_moved[point] {
        true => mesh.positions[point].as_vec3() * sphere.radius + sphere.centre,
        false => source.positions[v as usize],
    };
    let positions = mesh.vertices.iter().enumerate().map(position).collect();
    let mut shape = weld::cut(&TriMesh { positions, triangles: faces.iter().map(|&f| mesh.points(f)).collect() });
    weld::move_coincident_apart(&mut shape, COINCIDENT_OFFSET * sphere.radius);

    let (vertices, triangles) = vertices(mesh, &faces, &shape);
    let wedge_of = |vertex: &Vertex| &mesh.wedges[vertex.wedge as usize];
    // Bones and morph targets belong to points; the rest to wedges.
    let of_points: Vec<u32> = vertices.iter().map(|v| mesh.vertices[wedge_of(v).point as usize]).collect();
    let of_wedges: Vec<u32> = vertices.iter().map(|v| wedge_of(v).vertex).collect();
    let (bound, mut out) = (source.gathered(&of_points), source.gathered(&of_wedges));
    (out.influences, out.morphs) = (bound.influences, bound.morphs);
    for (i, vertex) in vertices.iter().enumerate() {
        out.positions[i] = shape.positions[vertex.point as usize];
        let wedge = wedge_of(vertex);
        if wedge.is_new {
            write_values(&mut out, i, wedge, scales);
        }
        if let Some(normal) = vertex.normal {
            out.normals[i] = normal;
        }
    }
    out.triangles = triangles;
    out.material = faces.iter().map(|&f| mesh.material(f)).collect();
    out
}

/// The vertices and triangles of a manifold of faces. A vertex is a wedge at a point of the manifold; where faces are flat, each
/// normal has one of its own.
fn vertices(mesh: &WedgeMesh, faces: &[u32], shape: &TriMesh) -> (Vec<Vertex>, Vec<[u32; 3]>) {
    let (mut known, mut vertices) = (HashMap::new(), Vec::new());
    let mut vertex = |wedge: u32, point: u32, normal: Option<Vec3>| {
        *known.entry((wedge, point, normal.map(|n| n.to_array().map(f32::to_bits)))).or_insert_with(|| {
            vertices.push(Vertex { wedge, point, normal });
            vertices.len() as u32 - 1
        })
    };
    let triangles = faces.iter().enumerate().map(|(t, &f)| {
        let (wedges, points) = (mesh.face(f), shape.triangles[t]);
        let normal = shape.area_vector(t).try_normalize();
        let normal_of = |wedge: u32| normal.filter(|_| mesh.wedges[wedge as usize].is_flat);
        [0, 1, 2].map(|k| vertex(wedges[k], points[k], normal_of(wedges[k])))
    });
    let triangles = triangles.collect();
    (vertices, triangles)
}

/// Writes the values of a wedge that no vertex of the source has.
fn write_values(out: &mut Surface, i: usize, wedge: &Wedge, scales: &Scales<'_>) {
    if let Some(normal) = Scales::normal_of(&wedge.values) {
        out.normals[i] = normal;
    }
    for set in 0..2 {
        if let (Some(uv), Some(slot)) = (scales.uv(&wedge.values, wedge.material, set), out.uvs[set].get_mut(i)) {
            *slot = uv;
        }
    }
    if let Some(color) = out.colors.get_mut(i) {
        *color = Scales::color_of(&wedge.values);
    }
}

/// The live faces by material, clear ones last, and within a material as in the source.
fn in_order(model: &Model, mesh: &WedgeMesh) -> Vec<u32> {
    let mut faces: Vec<u32> = mesh.live().collect();
    faces.sort_by_key(|&f| {
        let material = mesh.material(f);
        (model.materials[material as usize].alpha_mode == AlphaMode::Blend, material, f)
    });
    faces
}
