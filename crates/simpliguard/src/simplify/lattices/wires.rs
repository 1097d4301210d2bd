//! Wires: thin components that bend, such as two spokes that meet at the rim. They are cut into straight bars.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3;

use super::part::component;
use super::segment::segment_distance;
use crate::data::TriMesh;
use crate::geometry::vertex_neighbours;

/// A component of more triangles is worth faces of its own.
const MOST_TRIANGLES: usize = 2000;
/// Largest distance of a vertex from the centre line, as a multiple of the thickness. A slice is two thicknesses long.
const REACH: f32 = 2.0;

/// The triangles of each straight piece of a component, which is no thicker than `thickness` to either side of a line. Empty
/// if it has another form.
pub(super) fn straight_pieces(mesh: &TriMesh, triangles: &[u32], thickness: f32) -> Vec<Vec<u32>> {
    if triangles.len() > MOST_TRIANGLES {
        return Vec::new();
    }
    let wire = component(mesh, triangles);
    let along = distances_from_one_end(&wire);
    let Some(line) = centre_line(&wire, &along, thickness) else { return Vec::new() };
    let corners = corners(&line, thickness);
    let mut pieces = vec![Vec::new(); corners.len() - 1];
    for (&triangle, vertices) in triangles.iter().zip(&wire.triangles) {
        let middle = vertices.iter().map(|&v| along[v as usize]).sum::<f32>() / 3.0;
        let inner = &corners[1..corners.len() - 1];
        pieces[inner.partition_point(|&corner| line[corner].along <= middle)].push(triangle);
    }
    pieces
}

/// The distances of all vertices from one that is at an end, along edges.
fn distances_from_one_end(mesh: &TriMesh) -> Vec<f32> {
    let neighbours = vertex_neighbours(mesh.positions.len(), &mesh.triangles);
    let from_anywhere = distances(mesh, &neighbours, 0);
    let end = (0..from_anywhere.len()).max_by(|&a, &b| from_anywhere[a].total_cmp(&from_anywhere[b])).unwrap_or(0);
    distances(mesh, &neighbours, end)
}

/// Dijkstra's distances of all vertices from `start`.
fn distances(mesh: &TriMesh, neighbours: &[Vec<u32>], start: usize) -> Vec<f32> {
    let mut distances = vec![f32::INFINITY; mesh.positions.len()];
    distances[start] = 0.0;
    // Distances are not negative, and so their bits are in the same order.
    let mut open = BinaryHeap::from([Reverse((0_u32, start as u32))]);
    while let Some(Reverse((bits, vertex))) = open.pop() {
        let (distance, vertex) = (f32::from_bits(bits), vertex as usize);
        if distance > distances[vertex] {
            continue;
        }
        for &next in &neighbours[vertex] {
            let further = distance + mesh.positions[vertex].distance(mesh.positions[next as usize]);
            if further < distances[next as usize] {
                distances[next as usize] = further;
                open.push(Reverse((further.to_bits(), next)));
            }
        }
    }
    distances
}

/// A point of a centre line.
#[derive(Clone, Copy, Debug, Default)]
struct LinePoint {
    position: Vec3,
    /// Distance from the end of the wire.
    along: f32,
}

/// The centres of the slices of a wire, from one end to the other. `None` if a slice is wide: it goes through two branches,
/// or through a sheet.
fn centre_line(wire: &TriMesh, along: &[f32], thickness: f32) -> Option<Vec<LinePoint>> {
    let slice = |v: usize| (along[v] / (2.0 * thickness)) as usize;
    let mut vertices: Vec<usize> = (0..along.len()).collect();
    vertices.sort_by(|&a, &b| along[a].total_cmp(&along[b]));
    let mut line = Vec::new();
    for slice in vertices.chunk_by(|&a, &b| slice(a) == slice(b)) {
        let mean = 1.0 / slice.len() as f32;
        let position = slice.iter().map(|&v| wire.positions[v]).sum::<Vec3>() * mean;
        if slice.iter().any(|&v| wire.positions[v].distance(position) > REACH * thickness) {
            return None;
        }
        line.push(LinePoint { position, along: slice.iter().map(|&v| along[v]).sum::<f32>() * mean });
    }
    (line.len() >= 2).then_some(line)
}

/// The points of a line at which it bends, with its ends: no point is further than `tolerance` from the segments between
/// them (Douglas and Peucker 1973).
fn corners(line: &[LinePoint], tolerance: f32) -> Vec<usize> {
    let (mut corners, mut open) = (vec![0], vec![line.len() - 1]);
    while let Some(&last) = open.last() {
        let first = corners[corners.len() - 1];
        let off = |i: &usize| segment_distance([line[*i].position; 2], [line[first].position, line[last].position]);
        let furthest = (first + 1..last).max_by(|a, b| off(a).total_cmp(&off(b)));
        match furthest.filter(|i| off(i) > tolerance) {
            Some(corner) => open.push(corner),
            None => corners.extend(open.pop()),
        }
    }
    corners
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A tube of four sides through points, each side `width` from the centre line, which is not along z.
    pub(in super::super) fn tube(points: &[Vec3], width: f32) -> TriMesh {
        let mut mesh = TriMesh::default();
        for (i, &point) in points.iter().enumerate() {
            let (before, after) = (points[i.saturating_sub(1)], points[(i + 1).min(points.len() - 1)]);
            let across = (after - before).cross(Vec3::Z).normalize() * width;
            let up = Vec3::Z * width;
            mesh.positions.extend([point + across, point + up, point - across, point - up]);
        }
        for ring in 0..points.len() as u32 - 1 {
            for side in 0..4 {
                let [a, b] = [4 * ring + side, 4 * ring + (side + 1) % 4];
                mesh.triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
            }
        }
        mesh
    }

    fn pieces(mesh: &TriMesh) -> Vec<Vec<u32>> {
        let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        straight_pieces(mesh, &all, 0.02)
    }

    #[test]
    fn a_wire_is_cut_where_it_bends() {
        let bent = tube(&[Vec3::ZERO, Vec3::X, Vec3::new(2.0, 0.001, 0.0), Vec3::new(2.0, 1.0, 0.0)], 0.01);
        let mut pieces = pieces(&bent);
        pieces.sort();
        assert_eq!(pieces, [(0..16).collect::<Vec<_>>(), (16..24).collect()]);
    }

    #[test]
    fn a_straight_wire_is_one_piece() {
        assert_eq!(pieces(&tube(&[Vec3::ZERO, Vec3::X, Vec3::X * 2.0], 0.01)).len(), 1);
    }

    #[test]
    fn rings_forks_and_sheets_are_no_wires() {
        let ring: Vec<Vec3> = (0..=16)
            .map(|i| std::f32::consts::TAU * i as f32 / 16.0)
            .map(|a| Vec3::new(a.cos(), a.sin(), 0.0))
            .collect();
        let mut closed = tube(&ring[..16], 0.01);
        for side in 0..4 {
            let [a, b] = [60 + side, 60 + (side + 1) % 4];
            closed.triangles.extend([[a, b, (side + 1) % 4], [a, (side + 1) % 4, side]]);
        }
        assert!(pieces(&closed).is_empty());
        let (mut fork, branch) =
            (tube(&[Vec3::ZERO, Vec3::X, Vec3::X * 2.0], 0.01), tube(&[Vec3::ZERO, Vec3::Y], 0.01));
        // The branch begins at the ring in the middle.
        fork.positions.extend(branch.positions[4..].iter().map(|p| *p + Vec3::X));
        fork.triangles.extend(branch.triangles.iter().map(|t| t.map(|v| v + if v < 4 { 4 } else { 8 })));
        assert!(pieces(&fork).is_empty());
        assert!(pieces(&tube(&[Vec3::ZERO, Vec3::X], 0.2)).is_empty());
    }

    #[test]
    fn distances_are_those_along_edges() {
        let mesh = TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)],
            triangles: vec![[0, 1, 2], [1, 3, 2]],
        };
        assert_eq!(
            distances(&mesh, &vertex_neighbours(4, &mesh.triangles), 0),
            [0.0, 1.0, std::f32::consts::SQRT_2, 1.0 + std::f32::consts::SQRT_2]
        );
    }
}
