//! The walls of a clear surface: its connected components, and what becomes of them.

use glam::Vec3;

use crate::data::{NO_PART, TriMesh};
use crate::geometry::{face_components, group_by_component};

/// Weight of the logarithm of the ratio of two walls' areas, beside the distances of their corners in radii: a pane in a frame
/// of the same size is told by it.
const AREA_WEIGHT: f32 = 0.2;

/// The connected components of a clear surface.
pub(super) struct Walls {
    walls: Vec<Wall>,
    radius: f32,
}

struct Wall {
    /// Triangles, of the source where it is one of the source.
    triangles: Vec<u32>,
    low: Vec3,
    high: Vec3,
    area: f32,
}

impl Walls {
    /// The walls of `mesh`, whose triangles are those of the source with the indices `source`. `radius` is that of the
    /// bounding sphere.
    pub(super) fn new(mesh: &TriMesh, source: &[u32], radius: f32) -> Self {
        let of_source = |wall: Wall| {
            let triangles = wall.triangles.iter().map(|&t| source[t as usize]).collect();
            Wall { triangles, ..wall }
        };
        Self { walls: components(mesh).into_iter().map(of_source).collect(), radius: radius.max(f32::MIN_POSITIVE) }
    }

    /// The mesh of the collapsed walls in the order of the source, and the wall of each of its faces. A viewer that does not
    /// sort blends the walls as it does those of the source.
    pub(super) fn in_source_order(&self, mesh: &TriMesh) -> (TriMesh, Vec<u32>) {
        let mut walls: Vec<(u32, Wall)> = components(mesh).into_iter().map(|wall| (self.origin(&wall), wall)).collect();
        walls.sort_by_key(|(origin, _)| *origin);
        let faces = walls.iter().flat_map(|(origin, wall)| wall.triangles.iter().map(move |&t| (t, *origin)));
        let (triangles, of_faces) = faces.map(|(t, origin)| (mesh.triangles[t as usize], origin)).unzip();
        (TriMesh { positions: mesh.positions.clone(), triangles }, of_faces)
    }

    /// The wall of each of the source's triangles, of which there are `count`.
    pub(super) fn of_source(&self, count: usize) -> Vec<u32> {
        let mut of_source = vec![NO_PART; count];
        for (wall, i) in self.walls.iter().zip(0..) {
            wall.triangles.iter().for_each(|&t| of_source[t as usize] = i);
        }
        of_source
    }

    /// The wall that a collapsed one comes from: of all, that which is most like it. Walls may lie in one place, so the
    /// distance alone does not tell.
    fn origin(&self, collapsed: &Wall) -> u32 {
        let difference = |wall: &Wall| {
            let corners = wall.low.distance(collapsed.low) + wall.high.distance(collapsed.high);
            let ratio = wall.area.max(f32::MIN_POSITIVE) / collapsed.area.max(f32::MIN_POSITIVE);
            corners / self.radius + AREA_WEIGHT * libm::logf(ratio).abs()
        };
        let differences = self.walls.iter().map(difference).zip(0..);
        differences.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, wall)| wall)
    }
}

fn components(mesh: &TriMesh) -> Vec<Wall> {
    let wall = |triangles: Vec<u32>| {
        let corners = || triangles.iter().flat_map(|&t| mesh.corners(t as usize));
        let low = corners().fold(Vec3::INFINITY, Vec3::min);
        let high = corners().fold(Vec3::NEG_INFINITY, Vec3::max);
        let area = triangles.iter().map(|&t| mesh.area_vector(t as usize).length()).sum();
        Wall { triangles, low, high, area }
    };
    group_by_component(&face_components(mesh.positions.len(), &mesh.triangles)).into_iter().map(wall).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::visibility::tests::nested;

    #[test]
    fn walls_keep_the_order_of_the_source() {
        let source = nested();
        let all: Vec<u32> = (0..source.triangles.len() as u32).collect();
        let walls = Walls::new(&source, &all, 1.0);
        let mut mesh = source.clone();
        mesh.triangles.reverse();
        let (ordered, of_faces) = walls.in_source_order(&mesh);
        assert!(ordered.triangles[..4].iter().flatten().all(|&v| v < 4), "{:?}", ordered.triangles);
        assert_eq!(of_faces, [[0; 4], [1; 4]].concat());
        assert_eq!(walls.of_source(9), [vec![0; 4], vec![1; 4], vec![NO_PART]].concat());
    }

    #[test]
    fn a_wall_in_the_place_of_another_is_told_by_its_area() {
        let square = |offset: u32| [[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|v| v + offset));
        let positions = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        // A square, and one of two sides.
        let mut back = square(4);
        back.iter_mut().for_each(|t| t.swap(0, 1));
        let triangles = [square(0), square(4), back].concat();
        let source = TriMesh { positions: [positions, positions].concat(), triangles };
        let walls = Walls::new(&source, &[0, 1, 2, 3, 4, 5], 1.0);
        let (_, of_faces) =
            walls.in_source_order(&TriMesh { triangles: source.triangles[2..].to_vec(), ..source.clone() });
        assert_eq!(of_faces, [1; 4]);
        let (_, of_faces) = walls.in_source_order(&TriMesh { triangles: source.triangles[..2].to_vec(), ..source });
        assert_eq!(of_faces, [0; 2]);
    }
}
