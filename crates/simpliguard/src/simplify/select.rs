//! Selects the best of several shapes for a budget.
//!
//! Shapes are compared by their render error. A tenth of a decibel, which a texture may paint over, is worth neither a
//! surface twice as far from the source, nor self-intersecting faces, nor cracks: all of them add to the score.

use super::self_intersection::{SEVERE, TOLERATED};
use super::shape::Shape;
use crate::data::Candidate;
use crate::geometry::Topology;

/// Factor on the score of a shape that is hardly self-intersecting.
const SLIGHT_HANDICAP: f64 = 1.05;
/// Factor on the score of a shape that is badly self-intersecting: one decibel.
const FULL_HANDICAP: f64 = 1.26;
/// A finer reconstruction is tried where the best clean score is at most this many times the score of a self-intersecting
/// winner.
const WITHIN_REACH: f64 = 1.27;
/// The score of a shape that is twice as far from the source as the closest one grows by this fraction.
const DISTANCE_WEIGHT: f64 = 0.2;
/// As [`DISTANCE_WEIGHT`], for a shape all of whose faces are self-intersecting.
const INTERSECTION_WEIGHT: f64 = 0.6;
/// As [`DISTANCE_WEIGHT`], for a shape with as many edges on its boundary as faces. Views that do not score see cracks, and
/// vertices beside them have less room to be refined.
const BOUNDARY_WEIGHT: f64 = 0.2;
/// Handles that a shape may have and still count as one piece.
const FEW_HANDLES: i64 = 2;
/// Distances below this are equal, as a fraction of the diagonal of the source's bounding box.
const EQUAL_DISTANCE: f32 = 2e-5;

/// The source's own triangles collapse to sound surfaces that score as well as any reconstruction. Finer reconstructions
/// would only come as close as they do.
pub(super) fn source_serves(selections: &[Selection]) -> bool {
    let is_sound = |selection: &Selection| {
        selection.0.iter().any(|e| e.shape.candidate == Candidate::Source && !e.self_intersects())
    };
    let wins = |selection: &Selection| {
        let scored = selection.0.iter().map(|entry| (entry.shape.candidate, selection.score(entry)));
        scored.min_by(|a, b| a.1.total_cmp(&b.1)).is_some_and(|(candidate, _)| candidate == Candidate::Source)
    };
    !selections.is_empty() && selections.iter().all(|selection| is_sound(selection) && wins(selection))
}

/// The shapes for one budget.
#[derive(Default)]
pub(super) struct Selection(Vec<Entry>);

/// A shape and its topology.
struct Entry {
    shape: Shape,
    topology: Topology,
}

impl From<Shape> for Entry {
    fn from(shape: Shape) -> Self {
        Self { topology: Topology::of(&shape.mesh), shape }
    }
}

impl Entry {
    /// Fraction of the faces that intersect others.
    fn self_intersecting_fraction(&self) -> f64 {
        self.shape.self_intersecting as f64 / self.faces()
    }

    fn self_intersects(&self) -> bool {
        self.self_intersecting_fraction() > TOLERATED
    }

    fn faces(&self) -> f64 {
        self.shape.mesh.triangles.len().max(1) as f64
    }

    fn distance(&self) -> f64 {
        f64::from(self.shape.deviation.mean.max(EQUAL_DISTANCE))
    }

    fn is_in_one_piece(&self) -> bool {
        self.topology.components == 1
            && self.topology.euler_characteristic >= 2 - 2 * FEW_HANDLES
            && !self.self_intersects()
    }
}

impl Selection {
    pub(super) fn add(&mut self, shape: Shape) {
        self.0.push(shape.into());
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// No reconstruction is in one piece with few handles and free of self-intersections. Parts lie close together then, and a
    /// thick surface may run around them.
    pub(super) fn wants_thick(&self) -> bool {
        let mut reconstructions =
            self.0.iter().filter(|entry| matches!(entry.shape.candidate, Candidate::Reconstruction(_)));
        !reconstructions.any(Entry::is_in_one_piece)
    }

    /// A finer reconstruction may be free of the self-intersections of the best shape.
    pub(super) fn wants_finer(&self) -> bool {
        let best = |self_intersecting: bool| {
            let entries = self.0.iter().filter(|entry| entry.self_intersects() == self_intersecting);
            entries.map(|entry| self.handicapped(entry)).fold(f64::INFINITY, f64::min)
        };
        let (clean, self_intersecting) = (best(false), best(true));
        self_intersecting < clean && self_intersecting * WITHIN_REACH >= clean && self.finest_renders_best()
    }

    /// The finest reconstruction renders better than coarser ones, and there are coarser ones.
    fn finest_renders_best(&self) -> bool {
        let reconstructions = self.0.iter().filter_map(|entry| match entry.shape.candidate {
            Candidate::Reconstruction(params) => Some((params.resolution, entry.shape.render_error)),
            _ => None,
        });
        let cells = || reconstructions.clone().map(|r| r.0);
        let best = reconstructions.clone().min_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0);
        best == cells().max() && best > cells().min()
    }

    /// The best shape.
    pub(super) fn into_best(self) -> Option<Shape> {
        let scores: Vec<f64> = self.0.iter().map(|entry| self.handicapped(entry)).collect();
        let candidates = self.0.into_iter().zip(scores);
        candidates.reduce(|best, next| if next.1 < best.1 { next } else { best }).map(|(entry, _)| entry.shape)
    }

    /// The score with the handicap of a self-intersecting shape.
    fn handicapped(&self, entry: &Entry) -> f64 {
        if !entry.self_intersects() {
            return self.score(entry);
        }
        let severity = (entry.self_intersecting_fraction() - TOLERATED) / (SEVERE - TOLERATED);
        self.score(entry) * (SLIGHT_HANDICAP + (FULL_HANDICAP - SLIGHT_HANDICAP) * severity.min(1.0))
    }

    fn score(&self, entry: &Entry) -> f64 {
        let closest = self.0.iter().map(Entry::distance).fold(f64::INFINITY, f64::min);
        let boundary = entry.topology.edges.boundary as f64 / entry.faces();
        entry.shape.render_error
            * (1.0 + DISTANCE_WEIGHT * (entry.distance() / closest - 1.0))
            * (1.0 + INTERSECTION_WEIGHT * entry.self_intersecting_fraction())
            * (1.0 + BOUNDARY_WEIGHT * boundary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Deviation, TriMesh};
    use crate::simplify::shape::Shortfall;

    /// Twenty-five closed parts of four faces.
    fn tetrahedra() -> TriMesh {
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let triangles = (0..25u32).flat_map(|part| faces.map(|face| face.map(|v| v + 4 * part))).collect();
        TriMesh { positions: vec![glam::Vec3::ZERO; 100], triangles }
    }

    fn shape(render_error: f64, mean: f32, self_intersecting: usize) -> Shape {
        Shape {
            mesh: tetrahedra(),
            double_sided: false,
            candidate: Candidate::Source,
            render_error,
            deviation: Deviation { mean, ..Deviation::default() },
            self_intersecting,
            shortfall: Shortfall::Components,
            cards: None,
        }
    }

    fn of<const N: usize>(shapes: [Shape; N]) -> Selection {
        Selection(shapes.into_iter().map(Entry::from).collect())
    }

    fn winner<const N: usize>(shapes: [Shape; N]) -> f64 {
        of(shapes).into_best().expect("one").render_error
    }

    #[test]
    fn the_better_picture_wins_unless_its_surface_is_much_farther_off() {
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.9, 1e-3, 0)]), 0.9);
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.9, 4e-3, 0)]), 1.0);
        assert_eq!(winner([shape(1.0, 0.0, 0), shape(0.9, 1e-5, 0)]), 0.9);
    }

    #[test]
    fn a_tangled_shape_wins_by_a_decibel_or_alone() {
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.85, 1e-3, 9)]), 1.0);
        assert_eq!(winner([shape(1.0, 1e-3, 1), shape(0.7, 1e-3, 9)]), 0.7);
        assert_eq!(winner([shape(0.85, 1e-3, 9)]), 0.85);
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.96, 1e-3, 2)]), 1.0);
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.85, 1e-3, 2)]), 0.85);
    }

    #[test]
    fn of_two_tangled_shapes_the_one_with_fewer_crossing_faces_may_render_worse() {
        assert_eq!(winner([shape(1.0, 1e-3, 50), shape(1.1, 1e-3, 10)]), 1.1);
        assert_eq!(winner([shape(1.0, 1e-3, 50), shape(1.1, 1e-3, 40)]), 1.0);
    }

    #[test]
    fn cracks_cost_as_a_surface_farther_off_does() {
        // One face with three edges on its boundary.
        let open = |error: f64| Shape {
            mesh: TriMesh { positions: vec![glam::Vec3::ZERO; 3], triangles: vec![[0, 1, 2]; 1] },
            ..shape(error, 1e-3, 0)
        };
        assert_eq!(winner([open(1.0), shape(1.5, 1e-3, 0)]), 1.5);
        assert_eq!(winner([open(1.0), shape(1.7, 1e-3, 0)]), 1.0);
    }

    #[test]
    fn the_source_serves_where_it_is_sound_and_as_good() {
        let coarse = Candidate::Reconstruction(crate::data::Reconstruction::new(128));
        let selection = |reconstructed: f64, self_intersecting: usize| {
            of([Shape { candidate: coarse, ..shape(reconstructed, 1e-3, 0) }, shape(1.0, 1e-3, self_intersecting)])
        };
        assert!(source_serves(&[selection(1.1, 0), selection(1.2, 0)]));
        assert!(!source_serves(&[selection(1.2, 0), selection(0.8, 0)]));
        assert!(!source_serves(&[selection(1.2, 9), selection(1.2, 0)]));
        assert!(!source_serves(&[selection(0.8, 0), selection(1.2, 0)]));
        assert!(!source_serves(&[]));
    }

    #[test]
    fn a_thick_surface_is_wanted_around_parts_that_lie_close_together() {
        let coarse = Candidate::Reconstruction(crate::data::Reconstruction::new(128));
        let tetrahedron = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let with = |triangles: Vec<[u32; 3]>, self_intersecting: usize| {
            let mesh = TriMesh { positions: vec![glam::Vec3::ZERO; 8], triangles };
            of([Shape { candidate: coarse, mesh, ..shape(1.0, 1e-3, self_intersecting) }]).wants_thick()
        };
        assert!(!with(tetrahedron.to_vec(), 0));
        assert!(with(tetrahedron.to_vec(), 4));
        assert!(with(tetrahedron.iter().copied().chain(tetrahedron.map(|t| t.map(|v| v + 4))).collect(), 0));
    }

    #[test]
    fn a_finer_surface_is_wanted_where_it_may_untangle_the_winner_and_finer_ones_render_better() {
        let reconstructed = |cells: u32, error: f64| Shape {
            candidate: Candidate::Reconstruction(crate::data::Reconstruction::new(cells)),
            ..shape(error, 1e-3, 0)
        };
        let wanted = |coarse: f64, fine: f64, self_intersecting: f64| {
            of([reconstructed(128, coarse), reconstructed(256, fine), shape(self_intersecting, 1e-3, 9)]).wants_finer()
        };
        assert!(wanted(1.1, 1.0, 0.7) && !wanted(1.1, 1.0, 0.5) && !wanted(1.1, 1.0, 0.9));
        assert!(!wanted(1.0, 1.1, 0.7));
        assert!(!of([reconstructed(128, 1.0), shape(0.7, 1e-3, 9)]).wants_finer());
    }
}
