//! Generalized winding numbers of a triangle soup (Barill et al. 2018): about one inside, about zero outside, also where
//! the soup has holes.

use glam::Vec3;
use simpliguard::data::{TriMesh, area_vector};

/// A node stands for its triangles from this many of its radii on.
const FAR: f32 = 3.0;
/// Most triangles of a leaf.
const LEAF: usize = 8;
/// Nodes that wait on the way through the tree. A tree of 2^32 triangles has half as many levels.
const STACK: usize = 64;

/// A tree over the triangles of a soup. Far nodes count as one point with an area vector.
pub(crate) struct WindingNumbers {
    nodes: Vec<Node>,
    /// Corners, in the order of the leaves.
    corners: Vec<[Vec3; 3]>,
}

struct Node {
    /// Centre of the triangles, weighted by area.
    centre: Vec3,
    /// Sum of the triangles' normals times their areas.
    area: Vec3,
    /// Distance from the centre to the farthest corner.
    radius: f32,
    /// Its triangles.
    first: usize,
    end: usize,
    /// The second child; the first one follows the node. `None` for a leaf.
    second: Option<usize>,
}

impl WindingNumbers {
    /// Builds the tree.
    pub(crate) fn new(mesh: &TriMesh) -> Self {
        let mut tree =
            Self { nodes: Vec::new(), corners: (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect() };
        if !tree.corners.is_empty() {
            tree.build(0, mesh.triangles.len());
        }
        tree
    }

    fn build(&mut self, first: usize, end: usize) -> usize {
        let index = self.nodes.len();
        self.nodes.push(Node::around(&self.corners[first..end], first, end));
        if end - first > LEAF {
            let middle = first + (end - first) / 2;
            halve(&mut self.corners[first..end]);
            self.build(first, middle);
            self.nodes[index].second = Some(self.build(middle, end));
        }
        index
    }

    /// The winding number around a point.
    pub(crate) fn at(&self, point: Vec3) -> f32 {
        let (mut angle, mut stack) = (0.0, [0; STACK]);
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index];
            let to = node.centre - point;
            let distance = to.length();
            match node.second {
                _ if distance > FAR * node.radius => angle += node.area.dot(to) / (distance * distance * distance),
                Some(second) => {
                    stack[depth..depth + 2].copy_from_slice(&[second, index + 1]);
                    depth += 2;
                }
                None => angle += self.corners[node.first..node.end].iter().map(|t| solid_angle(t, point)).sum::<f32>(),
            }
        }
        angle / (4.0 * std::f32::consts::PI)
    }
}

impl Node {
    fn around(corners: &[[Vec3; 3]], first: usize, end: usize) -> Self {
        let (mut centre, mut area, mut total) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        for triangle in corners {
            let vector = 0.5 * area_vector(*triangle);
            let weight = vector.length();
            centre += weight * middle(triangle);
            area += vector;
            total += weight;
        }
        let centre = if total > 0.0 { centre / total } else { corners[0][0] };
        let radius = corners.iter().flatten().map(|p| p.distance(centre)).fold(0.0, f32::max);
        Self { centre, area, radius, first, end, second: None }
    }
}

fn middle([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (a + b + c) / 3.0
}

/// Puts the lower half along the longest side of the box around the middles in front.
fn halve(corners: &mut [[Vec3; 3]]) {
    let bounds = |pick: fn(Vec3, Vec3) -> Vec3| corners.iter().map(middle).reduce(pick).unwrap_or_default();
    let size = bounds(Vec3::max) - bounds(Vec3::min);
    let axis = if size.x >= size.y.max(size.z) { 0 } else { 1 + usize::from(size.z > size.y) };
    let half = corners.len() / 2;
    corners.select_nth_unstable_by(half, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]));
}

/// The solid angle of a triangle seen from a point (Van Oosterom and Strackee 1983); zero on the triangle's plane.
fn solid_angle(triangle: &[Vec3; 3], point: Vec3) -> f32 {
    let [a, b, c] = triangle.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    let above = a.dot(b.cross(c));
    if above == 0.0 { 0.0 } else { 2.0 * angle(above, below) }
}

/// The angle of a vector within 3e-4 radians, the same on every machine. Most of the time of a grid goes here, and winding
/// numbers are only held against a half.
fn angle(y: f32, x: f32) -> f32 {
    use std::f32::consts::{FRAC_PI_2, PI};
    let (small, large) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
    let ratio = small / large;
    let square = ratio * ratio;
    let first = ((-0.046_496_475 * square + 0.159_314_22) * square - 0.327_622_76) * square * ratio + ratio;
    let quadrant = if y.abs() > x.abs() { FRAC_PI_2 - first } else { first };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    half.copysign(y)
}

#[cfg(test)]
mod tests {
    use super::super::volume::tests::cuboid;
    use super::*;

    #[test]
    fn a_box_winds_once_around_its_inside() {
        let winding = WindingNumbers::new(&cuboid(Vec3::ZERO, Vec3::ONE));
        for (point, expected) in [(Vec3::splat(0.5), 1.0), (Vec3::splat(0.01), 1.0), (Vec3::splat(1.01), 0.0)] {
            assert!((winding.at(point) - expected).abs() < 1e-3, "{point}: {}", winding.at(point));
        }
        assert!(winding.at(Vec3::splat(100.0)).abs() < 1e-4);
        assert_eq!(WindingNumbers::new(&TriMesh::default()).at(Vec3::ZERO), 0.0);
    }

    #[test]
    fn an_open_box_winds_by_what_it_covers() {
        let mut open = cuboid(-Vec3::ONE, Vec3::ONE);
        open.triangles.truncate(10);
        assert!((WindingNumbers::new(&open).at(Vec3::ZERO) - 5.0 / 6.0).abs() < 1e-3);
    }

    #[test]
    fn angles_are_those_of_the_library() {
        for k in 0..1000 {
            let expected = (k as f32 + 0.5) * 0.002 * std::f32::consts::PI - std::f32::consts::PI;
            let found = angle(7.0 * expected.sin(), 7.0 * expected.cos());
            assert!((found - expected).abs() < 3e-4, "{expected}: {found}");
        }
    }

    #[test]
    fn far_nodes_stand_for_their_triangles() {
        let mut many = TriMesh::default();
        let places = (0..216).map(|i| Vec3::new((i % 6) as f32, (i / 6 % 6) as f32, (i / 36) as f32));
        places.for_each(|place| many.append(&cuboid(2.0 * place, 2.0 * place + 1.0)));
        let tree = WindingNumbers::new(&many);
        for point in [Vec3::new(4.5, 6.5, 2.5), Vec3::new(5.5, 5.5, 5.5), Vec3::new(-1.0, 3.0, 4.0)] {
            let exact: f32 = (0..many.triangles.len()).map(|t| solid_angle(&many.corners(t), point)).sum();
            let exact = exact / (4.0 * std::f32::consts::PI);
            assert!((tree.at(point) - exact).abs() < 0.03, "{point}: {} {exact}", tree.at(point));
        }
    }
}
