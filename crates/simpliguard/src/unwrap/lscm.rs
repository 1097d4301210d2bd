//! Least squares conformal maps (Levy, Petitjean, Ray and Maillot 2002).
//!
//! A triangle with flat corners `z_j` and complex texture coordinates `u_j` is mapped conformally iff
//! `sum_j W_j u_j = 0` with `W_j = z_{j+2} - z_{j+1}`. The map minimises `sum_T |sum_j W_j u_j|^2 / d_T` (`d_T` twice
//! the area), a Hermitian form in the `u_j`, with two boundary vertices pinned that lie far apart.
//!
//! A few local-global steps of an as-rigid-as-possible map (Liu et al. 2008) follow, which preserve area at the cost of
//! angles where charts are curved. Of both maps, the valid one with less stretch is used.

use glam::DVec2;

use super::chart::Chart;
use super::half_edge_mesh::HalfEdgeMesh;
use super::quality::{self, StretchLimit};
use super::solver::{Envelope, conj_mul, mul, ordering};
use crate::geometry::doubled_area;

/// Local-global steps; the stretch hardly falls after that many.
const RIGID_STEPS: usize = 6;

/// Vertex positions of a disc laid flat, with all triangles counter-clockwise, no overlap and limited stretch; `None`
/// if neither map has these properties or the chart is not a disc.
pub(super) fn parametrise(mesh: &HalfEdgeMesh, chart: &Chart, limit: StretchLimit) -> Option<Vec<DVec2>> {
    let boundary = chart.boundary.as_ref()?;
    if let [face] = chart.faces[..] {
        let mut uv = vec![DVec2::ZERO; 3];
        for k in 0..3 {
            uv[chart.corners[0][k] as usize] = mesh.flat[face as usize][k];
        }
        return Some(uv);
    }
    let system = ChartSystem::new(mesh, chart);
    let conformal = system.conformal(farthest_pair(mesh, chart, boundary))?;
    let rigid = system.rigid(&conformal);
    let mut best: Option<(f64, Vec<DVec2>)> = None;
    for mut uv in [Some(conformal), rigid].into_iter().flatten() {
        if let Some(stretch) = quality::even_out(mesh, chart, &mut uv)
            && stretch <= limit.0
            && best.as_ref().is_none_or(|(least, _)| stretch < *least)
            && quality::is_valid(mesh, chart, boundary, &uv)
        {
            best = Some((stretch, uv));
        }
    }
    best.map(|(_, uv)| uv)
}

/// The equations of the maps of one chart.
struct ChartSystem<'a> {
    chart: &'a Chart,
    /// Flat corners of each face of the chart.
    flat: Vec<[DVec2; 3]>,
    /// Position of each vertex in the order of elimination.
    position: Vec<u32>,
}

impl<'a> ChartSystem<'a> {
    fn new(mesh: &HalfEdgeMesh, chart: &'a Chart) -> Self {
        Self {
            chart,
            flat: chart.faces.iter().map(|&f| mesh.flat[f as usize]).collect(),
            position: ordering(chart.vertices, &chart.corners),
        }
    }

    /// The least squares conformal map with two vertices pinned as far apart as they are in space.
    fn conformal(&self, pins: [(u32, DVec2); 2]) -> Option<Vec<DVec2>> {
        let pinned = |v: u32| pins.iter().find(|p| p.0 == v).map(|p| p.1);
        let row = self.rows_without(&pins.map(|p| p.0));
        let mut matrix = self.empty_matrix(&row);
        let mut rhs = vec![DVec2::ZERO; self.chart.vertices - 2];
        for (corners, z) in self.chart.corners.iter().zip(&self.flat) {
            let weight: [DVec2; 3] = std::array::from_fn(|j| z[(j + 2) % 3] - z[(j + 1) % 3]);
            let inverse = 1.0 / doubled_area(z);
            for (i, &vi) in corners.iter().enumerate() {
                let Some(r) = row[vi as usize] else { continue };
                for (j, &vj) in corners.iter().enumerate() {
                    let entry = conj_mul(weight[i], weight[j]) * inverse;
                    match (row[vj as usize], pinned(vj)) {
                        (Some(c), _) if c <= r => matrix.add(r, c, entry),
                        (None, Some(u)) => rhs[r] -= mul(entry, u),
                        _ => {}
                    }
                }
            }
        }
        matrix.factorise()?;
        matrix.solve(&mut rhs);
        Some(self.gather(&row, &rhs, |v| pinned(v).unwrap_or_default()))
    }

    /// The as-rigid-as-possible map after [`RIGID_STEPS`] steps from `uv`.
    fn rigid(&self, uv: &[DVec2]) -> Option<Vec<DVec2>> {
        let row = self.rows_without(&[0]);
        let mut matrix = self.empty_matrix(&row);
        for (corners, z) in self.chart.corners.iter().zip(&self.flat) {
            for (k, weight) in cotangents(z).into_iter().enumerate() {
                let ends = [corners[(k + 1) % 3], corners[(k + 2) % 3]].map(|v| row[v as usize]);
                for r in ends.into_iter().flatten() {
                    matrix.add(r, r, DVec2::new(weight, 0.0));
                }
                if let [Some(a), Some(b)] = ends {
                    matrix.add(a.max(b), a.min(b), DVec2::new(-weight, 0.0));
                }
            }
        }
        matrix.factorise()?;
        let mut uv = uv.to_vec();
        for _ in 0..RIGID_STEPS {
            let mut rhs = self.rotated_edges(&row, &uv);
            matrix.solve(&mut rhs);
            uv = self.gather(&row, &rhs, |_| DVec2::ZERO);
        }
        Some(uv)
    }

    /// The right-hand side of the global step: the flat edges of each triangle, rotated to fit `uv` best.
    fn rotated_edges(&self, row: &[Option<usize>], uv: &[DVec2]) -> Vec<DVec2> {
        let mut rhs = vec![DVec2::ZERO; self.chart.vertices - 1];
        for (corners, z) in self.chart.corners.iter().zip(&self.flat) {
            let weights = cotangents(z);
            let edge = |k: usize| z[(k + 2) % 3] - z[(k + 1) % 3];
            let image = |k: usize| uv[corners[(k + 2) % 3] as usize] - uv[corners[(k + 1) % 3] as usize];
            let fit = (0..3).fold(DVec2::ZERO, |sum, k| sum + conj_mul(edge(k), image(k)) * weights[k]);
            let rotation = fit.try_normalize().unwrap_or(DVec2::X);
            for (k, weight) in weights.into_iter().enumerate() {
                let target = mul(rotation, edge(k)) * weight;
                if let Some(r) = row[corners[(k + 2) % 3] as usize] {
                    rhs[r] += target;
                }
                if let Some(r) = row[corners[(k + 1) % 3] as usize] {
                    rhs[r] -= target;
                }
            }
        }
        rhs
    }

    /// Row of each vertex, `None` for the fixed ones.
    fn rows_without(&self, fixed: &[u32]) -> Vec<Option<usize>> {
        let before = |p: u32| fixed.iter().filter(|&&v| self.position[v as usize] < p).count();
        (0..self.chart.vertices as u32)
            .map(|v| {
                let p = self.position[v as usize];
                (!fixed.contains(&v)).then(|| p as usize - before(p))
            })
            .collect()
    }

    /// A zero matrix with the envelope of the chart's edges.
    fn empty_matrix(&self, row: &[Option<usize>]) -> Envelope {
        let mut first: Vec<usize> = (0..row.iter().flatten().count()).collect();
        for corners in &self.chart.corners {
            let rows = corners.map(|v| row[v as usize]);
            let least = rows.into_iter().flatten().min().unwrap_or(0);
            for r in rows.into_iter().flatten() {
                first[r] = first[r].min(least);
            }
        }
        Envelope::new(first)
    }

    /// The values by vertex: from its row, or `fixed` if it has none.
    fn gather(&self, row: &[Option<usize>], values: &[DVec2], fixed: impl Fn(u32) -> DVec2) -> Vec<DVec2> {
        row.iter().enumerate().map(|(v, r)| r.map_or_else(|| fixed(v as u32), |r| values[r])).collect()
    }
}

/// Half the cotangent of each corner's angle: the weight of the opposite edge.
fn cotangents(z: &[DVec2; 3]) -> [f64; 3] {
    let doubled = doubled_area(z);
    std::array::from_fn(|k| {
        let (a, b) = (z[(k + 1) % 3] - z[k], z[(k + 2) % 3] - z[k]);
        0.5 * a.dot(b) / doubled
    })
}

/// Two boundary vertices far apart in space, and where to pin them.
fn farthest_pair(mesh: &HalfEdgeMesh, chart: &Chart, boundary: &[u32]) -> [(u32, DVec2); 2] {
    let mut place = vec![glam::DVec3::ZERO; chart.vertices];
    for (corners, &f) in chart.corners.iter().zip(&chart.faces) {
        for k in 0..3 {
            place[corners[k] as usize] = mesh.corners[f as usize][k];
        }
    }
    let farthest_from = |from: u32| {
        let distance = |v: u32| place[from as usize].distance_squared(place[v as usize]);
        boundary.iter().copied().filter(|&v| v != from).fold(None, |best: Option<u32>, v| match best {
            Some(b) if distance(b) >= distance(v) => best,
            _ => Some(v),
        })
    };
    let start = boundary.first().copied().unwrap_or(0);
    let a = farthest_from(start).unwrap_or(start);
    let b = farthest_from(a).unwrap_or(start);
    let distance = place[a as usize].distance(place[b as usize]).max(1e-6);
    [(a, DVec2::ZERO), (b, DVec2::new(distance, 0.0))]
}

#[cfg(test)]
mod tests {
    use super::super::tests::{cube, cylinder};
    use super::*;

    #[test]
    fn flat_and_unrolled_charts_keep_their_shape_exactly() {
        for (mesh, faces) in [(cube(), vec![0, 1]), (cylinder(24), (0..24).collect::<Vec<u32>>())] {
            let mesh = HalfEdgeMesh::new(&mesh, None);
            let chart = Chart::new(&mesh, faces);
            let uv = parametrise(&mesh, &chart, StretchLimit(1.001)).expect("developable");
            for (i, &f) in chart.faces.iter().enumerate() {
                let (t, z) = (chart.triangle(&uv, i), mesh.flat[f as usize]);
                for k in 0..3 {
                    let lengths = [t, z].map(|p| p[k].distance(p[(k + 1) % 3]));
                    assert!((lengths[0] - lengths[1]).abs() < 1e-6, "{lengths:?}");
                }
            }
        }
    }

    #[test]
    fn a_bent_fan_is_mapped_conformally_when_a_conformal_map_exists() {
        // Two faces can always be laid flat without any distortion.
        let mesh = crate::data::TriMesh {
            positions: vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y, glam::Vec3::new(1.0, 1.0, 1.0)],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
        };
        let mesh = HalfEdgeMesh::new(&mesh, None);
        let chart = Chart::new(&mesh, vec![0, 1]);
        let boundary = chart.boundary.clone().expect("disc");
        let uv = ChartSystem::new(&mesh, &chart).conformal(farthest_pair(&mesh, &chart, &boundary)).expect("solved");
        for (i, corners) in chart.corners.iter().enumerate() {
            let z = mesh.flat[i];
            let ratio = |k: usize| {
                let image = uv[corners[(k + 1) % 3] as usize] - uv[corners[k] as usize];
                conj_mul(z[(k + 1) % 3] - z[k], image) / z[k].distance_squared(z[(k + 1) % 3])
            };
            assert!(ratio(0).distance(ratio(1)) < 1e-9 && ratio(1).distance(ratio(2)) < 1e-9);
        }
    }
}
