//! Components that are lattices or bars of one.

use std::collections::HashMap;

use glam::Vec3;

use crate::data::TriMesh;
use crate::geometry::Topology;
use crate::simplify::oriented_box::OrientedBox;

/// Largest half thickness of a lattice and of a bar, as a fraction of the radius of the bounding sphere: it is no thicker
/// than a few pixels where the model fills the screen.
pub(super) const THICKNESS: f32 = 0.012;
/// Least half width of a lattice, in the same measure: small things collapse well.
pub(super) const WIDTH: f32 = 0.04;
/// Fewest holes of a lattice.
const HOLES: i64 = 8;
/// Largest fraction of its rectangle that a lattice covers.
const COVER: f32 = 0.6;
/// Least length of a bar, as a multiple of its width.
const SLENDER: f32 = 4.0;

/// A connected component that does not bend.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Triangles of the source.
    pub(super) triangles: Vec<u32>,
    /// The bone that holds it.
    pub(super) bone: u16,
    pub(super) around: OrientedBox,
}

impl Part {
    /// The component of these triangles of `mesh`, which are the triangles `source` of the source.
    pub(super) fn new(mesh: &TriMesh, triangles: &[u32], source: Vec<u32>, bone: u16) -> Self {
        let points: Vec<Vec3> = triangles.iter().flat_map(|&t| mesh.corners(t as usize)).collect();
        Self { triangles: source, bone, around: OrientedBox::around(&points) }
    }

    /// The number of its holes, if it is flat, large enough, and full of them. `radius` is that of the bounding sphere of the
    /// source.
    pub(super) fn holes(&self, mesh: &TriMesh, triangles: &[u32], radius: f32) -> Option<u32> {
        let half = self.around.half / radius;
        if half.z > THICKNESS || half.x.min(half.y) < WIDTH {
            return None;
        }
        let across = |&t: &u32| mesh.area_vector(t as usize).dot(self.around.axes.z_axis).abs();
        // Both sides count, with half of the area each.
        let covered = triangles.iter().map(across).sum::<f32>() * 0.25;
        let holes = if covered <= COVER * self.around.area() { holes(mesh, triangles) } else { 0 };
        (holes >= HOLES).then_some(holes as u32)
    }

    /// It is thin and long.
    pub(super) fn is_bar(&self, radius: f32) -> bool {
        let half = self.around.half;
        let width = half.y.max(half.z);
        width <= THICKNESS * radius && half.x >= SLENDER * width
    }

    /// The ends of a bar.
    pub(super) fn ends(&self) -> [Vec3; 2] {
        let along = self.around.axes.x_axis * self.around.half.x;
        [self.around.centre - along, self.around.centre + along]
    }
}

/// The triangles `triangles` of a mesh as a mesh of their own, in the same order.
pub(super) fn component(mesh: &TriMesh, triangles: &[u32]) -> TriMesh {
    let (mut component, mut ids) = (TriMesh::default(), HashMap::new());
    for &t in triangles {
        let triangle = mesh.triangles[t as usize].map(|v| {
            *ids.entry(v).or_insert_with(|| {
                component.positions.push(mesh.positions[v as usize]);
                component.positions.len() as u32 - 1
            })
        });
        component.triangles.push(triangle);
    }
    component
}

/// The number of holes through a component: its genus if it is closed, one less than the number of its borders if it is
/// flat.
fn holes(mesh: &TriMesh, triangles: &[u32]) -> i64 {
    let Topology { edges, euler_characteristic, .. } = Topology::of(&component(mesh, triangles));
    if edges.boundary == 0 { 1 - euler_characteristic / 2 } else { 1 - euler_characteristic }
}
