//! Regularisation loss (`L_struct`, paper 3.4): Laplacian smoothing, and vertex normals that agree along edges.
//!
//! The Laplacian is taken of the displacements and not of the positions, so that corners of the initial mesh are kept.

use glam::Vec3;

use crate::data::area_vector;
use crate::refine::low_poly::LowPoly;

/// Both regularisation losses of one mesh.
pub(in crate::refine) struct Regularisation {
    /// Initial positions.
    origin: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    edges: Edges,
    laplacian_weight: f32,
    normal_weight: f32,
}

impl Regularisation {
    /// The losses of displacements from `low` as it is.
    pub(in crate::refine) fn new(low: &LowPoly, laplacian_weight: f32, normal_weight: f32) -> Self {
        let edges = Edges::new(low.positions.len(), &low.triangles);
        Self { origin: low.positions.clone(), triangles: low.triangles.clone(), edges, laplacian_weight, normal_weight }
    }

    /// With the Laplacian of the positions, as printed in the paper. It also smooths the corners of the initial mesh.
    pub(in crate::refine) fn of_positions(self) -> Self {
        Self { origin: vec![Vec3::ZERO; self.origin.len()], ..self }
    }

    /// Adds the gradient of the weighted losses at `positions`; returns their sum.
    pub(in crate::refine) fn add_gradient(&self, positions: &[Vec3], gradient: &mut [Vec3]) -> f64 {
        let displacements: Vec<Vec3> = positions.iter().zip(&self.origin).map(|(a, b)| *a - *b).collect();
        let laplacian = self.edges.add_laplacian(&displacements, self.laplacian_weight, gradient);
        if self.normal_weight == 0.0 {
            return laplacian;
        }
        laplacian + self.edges.add_normals(positions, &self.triangles, self.normal_weight, gradient)
    }
}

/// Neighbours of each vertex over edges, flattened.
struct Edges {
    /// Index of the first neighbour of each vertex, and the number of neighbours at the end.
    first: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Edges {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut pairs: Vec<(u32, u32)> =
            triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let first = (0..=vertices as u32).map(|v| pairs.partition_point(|p| p.0 < v) as u32).collect();
        Self { first, neighbours: pairs.into_iter().map(|p| p.1).collect() }
    }

    /// Neighbours of vertex `v`.
    fn of(&self, v: usize) -> &[u32] {
        &self.neighbours[self.first[v] as usize..self.first[v + 1] as usize]
    }

    /// Adds the gradient of `weight / n sum |mean of neighbours - own|^2` over the field `d`; returns that loss.
    fn add_laplacian(&self, d: &[Vec3], weight: f32, gradient: &mut [Vec3]) -> f64 {
        let scale = weight / d.len().max(1) as f32;
        let mut loss = 0.0;
        for v in 0..d.len() {
            let neighbours = self.of(v);
            if neighbours.is_empty() {
                continue;
            }
            let share = 1.0 / neighbours.len() as f32;
            let delta = neighbours.iter().map(|&n| d[n as usize]).sum::<Vec3>() * share - d[v];
            loss += f64::from(scale * delta.length_squared());
            let g = delta * (2.0 * scale);
            gradient[v] -= g;
            for &n in neighbours {
                gradient[n as usize] += g * share;
            }
        }
        loss
    }

    /// Adds the gradient of `weight / faces sum (1 - cos(n_1, n_2))` over the edges, `n_1` and `n_2` being the
    /// area-weighted normals of an edge's vertices; returns that loss.
    fn add_normals(&self, positions: &[Vec3], triangles: &[[u32; 3]], weight: f32, gradient: &mut [Vec3]) -> f64 {
        let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
        let mut sums = vec![Vec3::ZERO; positions.len()];
        for t in triangles {
            let area = area_vector(corners(t));
            t.iter().for_each(|&v| sums[v as usize] += area);
        }
        let normals: Vec<Vec3> = sums.iter().map(|n| n.normalize_or_zero()).collect();
        let scale = weight / triangles.len().max(1) as f32;
        let mut loss = 0.0;
        // Gradient at the sums. Its component along a normal is dropped: it does not turn the normal.
        let mut by_sum = vec![Vec3::ZERO; positions.len()];
        for (v, normal) in normals.iter().enumerate() {
            let around: Vec3 = self.of(v).iter().map(|&n| normals[n as usize]).sum();
            // Every edge is visited from both ends.
            loss += 0.5 * f64::from(scale) * f64::from(self.of(v).len() as f32 - normal.dot(around));
            if *normal != Vec3::ZERO {
                by_sum[v] = (*normal * normal.dot(around) - around) * (scale / sums[v].length());
            }
        }
        for t in triangles {
            let [a, b, c] = corners(t);
            let by_area: Vec3 = t.iter().map(|&v| by_sum[v as usize]).sum();
            let (by_b, by_c) = ((c - a).cross(by_area), by_area.cross(b - a));
            gradient[t[0] as usize] -= by_b + by_c;
            gradient[t[1] as usize] += by_b;
            gradient[t[2] as usize] += by_c;
        }
        loss
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    /// Compares `add`, which adds a gradient at a field and returns the loss, with central differences of the loss.
    fn check(mut field: Vec<Vec3>, add: impl Fn(&[Vec3], &mut [Vec3]) -> f64) {
        let mut gradient = vec![Vec3::ZERO; field.len()];
        add(&field, &mut gradient);
        assert!(gradient.iter().any(|g| g.length() > 1e-3), "{gradient:?}");
        for v in 0..field.len() {
            for axis in 0..3 {
                let h = 1e-2;
                let mut at = |x: f32| {
                    let old = field[v][axis];
                    field[v][axis] += x;
                    let loss = add(&field, &mut vec![Vec3::ZERO; field.len()]);
                    field[v][axis] = old;
                    loss
                };
                let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
                let analytic = f64::from(gradient[v][axis]);
                assert!((difference - analytic).abs() < 2e-4, "vertex {v}, axis {axis}: {difference} {analytic}");
            }
        }
    }

    #[test]
    fn the_laplacian_matches_central_differences() {
        let edges = Edges::new(4, &TETRAHEDRON[..3]);
        let d = vec![Vec3::new(0.1, 0.4, -0.3), Vec3::X, Vec3::new(0.0, -0.7, 0.2), Vec3::ZERO];
        check(d, |d, gradient| edges.add_laplacian(d, 0.7, gradient));
    }

    #[test]
    fn positions_have_a_loss_at_rest_and_displacements_have_none() {
        let positions = vec![Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 3.0];
        let atlas = crate::data::Atlas { uvs: vec![Default::default()], ..Default::default() };
        let mesh = crate::data::TriMesh { positions: positions.clone(), triangles: vec![[0, 1, 2]] };
        let low = LowPoly::new(&mesh, &atlas, false, crate::refine::TexelGrid::empty());
        let loss = |losses: Regularisation| losses.add_gradient(&positions, &mut [Vec3::ZERO; 3]);
        assert_eq!(loss(Regularisation::new(&low, 2.0, 0.0)), 0.0);
        // Each vertex is 1.5 times as far from the mean of the other two as from the centre (1, 1, 0).
        let squares = 2.25 * (2.0 + 5.0 + 5.0);
        let found = loss(Regularisation::new(&low, 2.0, 0.0).of_positions());
        assert!((found - 2.0 / 3.0 * squares).abs() < 1e-5, "{found}");
    }

    #[test]
    fn the_consistency_of_normals_matches_central_differences() {
        let edges = Edges::new(4, &TETRAHEDRON);
        let positions = vec![Vec3::new(0.1, 0.2, -0.3), Vec3::X * 2.0, Vec3::Y * 1.5, Vec3::new(0.2, 0.3, 1.7)];
        check(positions, |p, gradient| edges.add_normals(p, &TETRAHEDRON, 0.7, gradient));
    }

    #[test]
    fn a_plane_has_consistent_normals() {
        let edges = Edges::new(4, &[[0, 1, 2], [0, 2, 3]]);
        let positions = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let mut gradient = [Vec3::ZERO; 4];
        assert!(edges.add_normals(&positions, &[[0, 1, 2], [0, 2, 3]], 1.0, &mut gradient).abs() < 1e-6);
        assert!(gradient.iter().all(|g| g.length() < 1e-6), "{gradient:?}");
    }

    #[test]
    fn a_shared_translation_is_free() {
        let edges = Edges::new(3, &[[0, 1, 2]]);
        let mut gradient = vec![Vec3::ZERO; 3];
        assert_eq!(edges.add_laplacian(&[Vec3::ONE; 3], 1.0, &mut gradient), 0.0);
        assert_eq!(gradient, [Vec3::ZERO; 3]);
    }
}
