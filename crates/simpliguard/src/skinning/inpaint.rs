//! Interpolation of weights over the edges of the level.
//!
//! Laplace's equation with the matched vertices fixed: `sum_j (w_i - w_j) / |e_ij| = 0` at every other vertex `i`, for
//! each bone separately. Its solution lies between the values around it and keeps sums of one. The system is symmetric
//! and positive definite if every unknown vertex is connected with a fixed one. It is solved by conjugate gradients
//! with the diagonal as preconditioner, in double precision, one bone per task: the result is equal for any number of
//! threads.

use rayon::prelude::*;

use crate::animation::Weights;
use crate::data::TriMesh;
use crate::geometry::vertex_components;

/// Residual at which the solution for a bone ends, relative to the first residual.
const TOLERANCE: f64 = 1e-7;

/// Weights below this are left out of an interpolated vertex.
const SMALLEST: f64 = 1e-6;
/// The row of a known vertex.
const NO_ROW: u32 = u32::MAX;

/// For each vertex, true if no path of edges connects it with a matched vertex.
pub(super) fn unreachable(mesh: &TriMesh, matched: &[bool]) -> Vec<bool> {
    let components = vertex_components(mesh.positions.len(), mesh.triangles.iter().copied());
    let mut is_reached = vec![false; matched.len()];
    for v in (0..matched.len()).filter(|&v| matched[v]) {
        is_reached[components[v] as usize] = true;
    }
    (0..matched.len()).map(|v| !is_reached[components[v] as usize]).collect()
}

/// Interpolates the weights of the vertices that are not `known`. Each of them must be connected with a known vertex.
pub(super) fn fill(mesh: &TriMesh, known: &[bool], weights: &mut [Weights]) {
    let system = System::new(mesh, known);
    if system.vertices.is_empty() {
        return;
    }
    let joints = system.joints_around(weights);
    let columns: Vec<Vec<f64>> = joints
        .par_iter()
        .map(|&joint| system.solve(&system.right_side(|v| f64::from(weights[v as usize].of(joint)))))
        .collect();
    for (row, &vertex) in system.vertices.iter().enumerate() {
        let mut filled = Weights::default();
        for (&joint, column) in joints.iter().zip(&columns) {
            if column[row] > SMALLEST {
                filled.add_joint(joint, column[row] as f32);
            }
        }
        weights[vertex as usize] = filled;
    }
}

/// The rows of the Laplacian for the unknown vertices.
struct System {
    /// Vertex of each row.
    vertices: Vec<u32>,
    /// Sum of the edge weights of each row.
    diagonal: Vec<f64>,
    /// Edges to other rows.
    inner: Vec<Vec<(u32, f64)>>,
    /// Edges to known vertices.
    outer: Vec<Vec<(u32, f64)>>,
}

impl System {
    fn new(mesh: &TriMesh, known: &[bool]) -> Self {
        let vertices: Vec<u32> = (0..known.len() as u32).filter(|&v| !known[v as usize]).collect();
        let mut row = vec![NO_ROW; known.len()];
        for (r, &v) in vertices.iter().enumerate() {
            row[v as usize] = r as u32;
        }
        let mut system = Self {
            diagonal: vec![0.0; vertices.len()],
            inner: vec![Vec::new(); vertices.len()],
            outer: vec![Vec::new(); vertices.len()],
            vertices,
        };
        let (low, high) = mesh.bounds();
        let shortest = f64::from((high - low).length()).max(f64::from(f32::MIN_POSITIVE)) * 1e-6;
        for (a, b) in edges(mesh) {
            let length = f64::from(mesh.positions[a as usize].distance(mesh.positions[b as usize]));
            let weight = 1.0 / length.max(shortest);
            for (from, to) in [(a, b), (b, a)] {
                let r = row[from as usize];
                if r == NO_ROW {
                    continue;
                }
                let r = r as usize;
                system.diagonal[r] += weight;
                match row[to as usize] {
                    NO_ROW => system.outer[r].push((to, weight)),
                    other => system.inner[r].push((other, weight)),
                }
            }
        }
        system
    }

    /// The joints of the known vertices next to unknown ones, in rising order.
    fn joints_around(&self, weights: &[Weights]) -> Vec<u16> {
        let around = self.outer.iter().flatten().flat_map(|&(v, _)| weights[v as usize].joints());
        let mut joints: Vec<u16> = around.collect();
        joints.sort_unstable();
        joints.dedup();
        joints
    }

    fn right_side(&self, value: impl Fn(u32) -> f64) -> Vec<f64> {
        self.outer.iter().map(|edges| edges.iter().map(|&(v, w)| w * value(v)).sum()).collect()
    }

    fn multiply(&self, x: &[f64]) -> Vec<f64> {
        self.inner
            .iter()
            .enumerate()
            .map(|(r, edges)| self.diagonal[r] * x[r] - edges.iter().map(|&(c, w)| w * x[c as usize]).sum::<f64>())
            .collect()
    }

    /// Preconditioned conjugate gradients from zero.
    fn solve(&self, right: &[f64]) -> Vec<f64> {
        let precondition = |r: &[f64]| -> Vec<f64> { r.iter().zip(&self.diagonal).map(|(r, d)| r / d).collect() };
        let mut x = vec![0.0; right.len()];
        let mut residual = right.to_vec();
        let mut scaled = precondition(&residual);
        let mut direction = scaled.clone();
        let mut energy = dot(&residual, &scaled);
        let enough = energy * TOLERANCE * TOLERANCE;
        // In exact arithmetic there are as many steps as unknowns; rounding adds some.
        for _ in 0..2 * right.len() + 16 {
            if energy <= enough {
                break;
            }
            let image = self.multiply(&direction);
            let step = energy / dot(&direction, &image);
            for i in 0..x.len() {
                x[i] += step * direction[i];
                residual[i] -= step * image[i];
            }
            scaled = precondition(&residual);
            let next = dot(&residual, &scaled);
            for (d, s) in direction.iter_mut().zip(&scaled) {
                *d = s + next / energy * *d;
            }
            energy = next;
        }
        x
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Every edge once, in rising order.
fn edges(mesh: &TriMesh) -> Vec<(u32, u32)> {
    let mut edges: Vec<(u32, u32)> = mesh
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .filter(|(a, b)| a != b)
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn on(joint: u16) -> Weights {
        let mut weights = Weights::default();
        weights.add_joint(joint, 1.0);
        weights
    }

    /// A strip of `n` quads of unit length along x.
    fn strip(n: u32) -> TriMesh {
        TriMesh {
            positions: (0..=n).flat_map(|i| [0.0, 1.0].map(|y| Vec3::new(i as f32, y, 0.0))).collect(),
            triangles: (0..n).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]).collect(),
        }
    }

    #[test]
    fn sums_stay_one_and_weights_run_from_end_to_end() {
        let mesh = strip(20);
        let n = mesh.positions.len();
        let mut known = vec![false; n];
        let mut weights = vec![Weights::default(); n];
        for (v, joint) in [(0, 3), (1, 3), (n - 2, 8), (n - 1, 8)] {
            known[v] = true;
            weights[v] = on(joint);
        }
        fill(&mesh, &known, &mut weights);
        for (v, w) in weights.iter().enumerate() {
            assert!((w.of(3) + w.of(8) - 1.0).abs() < 1e-5);
            let expected = 1.0 - mesh.positions[v].x / 20.0;
            // The diagonals tilt the isolines a little.
            assert!((w.of(3) - expected).abs() < 0.03, "vertex {v}: {} against {expected}", w.of(3));
        }
    }

    #[test]
    fn pieces_without_a_match_are_found() {
        let mut mesh = strip(1);
        mesh.positions.extend([Vec3::splat(9.0); 4]);
        mesh.triangles.push([4, 5, 6]);
        let mut matched = vec![false; 8];
        matched[0] = true;
        assert_eq!(unreachable(&mesh, &matched), [false, false, false, false, true, true, true, true]);
    }
}
