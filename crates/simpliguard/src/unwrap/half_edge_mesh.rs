//! The mesh of the stage: faces in double precision, each laid flat in its own plane, and their adjacency.

use glam::{DVec2, DVec3};

use crate::data::TriMesh;
use crate::geometry::{area_vector, doubled_area, sorted_half_edges};

/// The opposite of a half-edge that has none.
pub(super) const NO_NEIGHBOUR: u32 = u32::MAX;

/// Least height of a flat triangle as a fraction of its longest side. Slivers and faces without area are fattened
/// to it, so that each of them can be parametrised.
const LEAST_ASPECT: f64 = 0.01;

/// Least longest side of a flat triangle as a fraction of the square root of the whole area.
const LEAST_SIDE: f64 = 1e-5;

/// Range of texel densities; faces outside of it would get too few texels or take too many from the others.
const DENSITY_RANGE: [f32; 2] = [1.0 / 16.0, 16.0];

/// Faces and half-edges; half-edge `3 f + k` runs from corner `k` to corner `k + 1` of face `f`.
pub(super) struct HalfEdgeMesh {
    /// Opposite of each half-edge; [`NO_NEIGHBOUR`] where the mesh ends, or is cut because it is not manifold.
    pub opposite: Vec<u32>,
    /// Length of each half-edge.
    pub length: Vec<f64>,
    /// Corners of each face, centred and scaled so that the area of all faces is about 1.
    pub corners: Vec<[DVec3; 3]>,
    /// Unit normal, zero for a face without area.
    pub normal: Vec<DVec3>,
    /// Each face laid flat in its own plane, counter-clockwise.
    pub flat: Vec<[DVec2; 3]>,
    /// Area of `flat`.
    pub area: Vec<f64>,
    /// Relative linear texel density of each face.
    pub density: Vec<f64>,
    /// Units of this mesh per unit of the source mesh.
    pub units: f64,
}

impl HalfEdgeMesh {
    /// The half-edge mesh of `mesh`; faces without a texel density, or with one that is not finite, have the density 1.
    pub(super) fn new(mesh: &TriMesh, texel_density: Option<&[f32]>) -> Self {
        let (positions, units) = normalised(mesh);
        let corners: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
        let flat: Vec<[DVec2; 3]> = corners.iter().map(lay_flat).collect();
        let length =
            corners.iter().flat_map(|c| [c[0].distance(c[1]), c[1].distance(c[2]), c[2].distance(c[0])]).collect();
        let density = |f: usize| {
            let value = texel_density.and_then(|i| i.get(f)).copied().filter(|d| d.is_finite()).unwrap_or(1.0);
            f64::from(value.clamp(DENSITY_RANGE[0], DENSITY_RANGE[1]))
        };
        Self {
            opposite: opposites(mesh),
            length,
            normal: corners.iter().map(|c| area_vector(c).normalize_or_zero()).collect(),
            area: flat.iter().map(|t| 0.5 * doubled_area(t)).collect(),
            density: (0..mesh.triangles.len()).map(density).collect(),
            flat,
            corners,
            units,
        }
    }

    /// Number of faces.
    pub(super) fn faces(&self) -> usize {
        self.corners.len()
    }

    /// The faces across the three sides of face `f`, each after the half-edge of `f` that separates both.
    pub(super) fn neighbours(&self, f: u32) -> impl Iterator<Item = (u32, u32)> + '_ {
        (3 * f..3 * f + 3).filter_map(|h| {
            let other = self.opposite[h as usize];
            (other != NO_NEIGHBOUR).then_some((h, other / 3))
        })
    }
}

/// Positions centred and scaled to a total face area of about 1, and that scale.
fn normalised(mesh: &TriMesh) -> (Vec<DVec3>, f64) {
    let finite = |v: &glam::Vec3| if v.is_finite() { v.as_dvec3() } else { DVec3::ZERO };
    let positions: Vec<DVec3> = mesh.positions.iter().map(finite).collect();
    let first = positions.first().copied().unwrap_or_default();
    let (low, high) = positions.iter().fold((first, first), |(l, h), &p| (l.min(p), h.max(p)));
    let extent = (high - low).max_element();
    let centre = 0.5 * (low + high);
    let unit = if extent > 0.0 { 1.0 / extent } else { 1.0 };
    let mut out: Vec<DVec3> = positions.iter().map(|&p| (p - centre) * unit).collect();
    let doubled: f64 = mesh.triangles.iter().map(|t| area_vector(&t.map(|v| out[v as usize])).length()).sum();
    let scale = if doubled > 0.0 { (2.0 / doubled).sqrt().min(1e6) } else { 1.0 };
    out.iter_mut().for_each(|p| *p *= scale);
    (out, unit * scale)
}

/// A triangle in its own plane, the first corner at the origin, counter-clockwise, fattened if it is a sliver.
fn lay_flat(corners: &[DVec3; 3]) -> [DVec2; 3] {
    let squared = |k: usize| corners[k].distance_squared(corners[(k + 1) % 3]);
    let base = (1..3).fold(0, |best, k| if squared(k) > squared(best) { k } else { best });
    let [a, b, c] = [base, (base + 1) % 3, (base + 2) % 3];
    let side = squared(base).sqrt();
    let length = side.max(LEAST_SIDE);
    let direction = (corners[b] - corners[a]) / side.max(f64::MIN_POSITIVE);
    let apex = corners[c] - corners[a];
    let along = if side < LEAST_SIDE { 0.5 * length } else { apex.dot(direction) };
    let height = (apex - direction * apex.dot(direction)).length().max(LEAST_ASPECT * length);
    let mut out = [DVec2::ZERO; 3];
    out[b] = DVec2::new(length, 0.0);
    out[c] = DVec2::new(along, height);
    let origin = out[0];
    out.map(|p| p - origin)
}

/// The opposite of each half-edge. Edges with other than two half-edges of opposite direction are cut; faces that
/// repeat a vertex do not count.
fn opposites(mesh: &TriMesh) -> Vec<u32> {
    let mut half_edges = sorted_half_edges(&mesh.triangles);
    half_edges.retain(|h| {
        let [a, b, c] = mesh.triangles[h.face() as usize];
        a != b && b != c && c != a
    });
    let mut out = vec![NO_NEIGHBOUR; 3 * mesh.triangles.len()];
    for run in half_edges.chunk_by(|a, b| a.edge == b.edge) {
        if let [a, b] = run
            && a.forward != b.forward
        {
            out[a.index as usize] = b.index;
            out[b.index as usize] = a.index;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn two_faces_of_a_quad_lie_side_by_side_and_a_third_cuts() {
        let mut mesh = TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y, Vec3::Z],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        assert_eq!(
            HalfEdgeMesh::new(&mesh, None).opposite,
            [NO_NEIGHBOUR, NO_NEIGHBOUR, 3, 2, NO_NEIGHBOUR, NO_NEIGHBOUR]
        );
        mesh.triangles.push([2, 0, 4]);
        assert!(HalfEdgeMesh::new(&mesh, None).opposite.iter().all(|&o| o == NO_NEIGHBOUR));
    }

    #[test]
    fn flat_faces_keep_their_sides_and_wind_counter_clockwise() {
        let corners = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.5, 2.0, 3.0), DVec3::new(1.2, 2.0, 2.0)];
        let flat = lay_flat(&corners);
        for k in 0..3 {
            let n = (k + 1) % 3;
            assert!((flat[k].distance(flat[n]) - corners[k].distance(corners[n])).abs() < 1e-12);
        }
        assert!(doubled_area(&flat) > 0.0);
    }

    #[test]
    fn faces_without_area_are_fattened() {
        for corners in [[DVec3::X; 3], [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X], [DVec3::ZERO, DVec3::ZERO, DVec3::X]] {
            assert!(doubled_area(&lay_flat(&corners)) > 0.0);
        }
    }
}
