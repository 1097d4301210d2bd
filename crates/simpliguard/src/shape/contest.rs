//! Which of several shapes for a budget is kept.
//!
//! Shapes are compared by what they render. A tenth of a decibel that a texture may paint over is worth neither a surface
//! twice as far from the source, nor faces that pass through each other, nor cracks: all of them add to the score.

use super::{Road, Shape};
use crate::mesh::Topology;

/// Part of a shape's faces that may pass through others before it counts as tangled.
pub(super) const MAY_INTERSECT: f64 = 0.01;
/// Part from which on it is tangled through and through.
const TANGLED_THROUGH: f64 = 0.05;
/// How many times smaller the score of a tangled shape must be than that of another: where it is hardly tangled, and
/// where it is so through and through, one decibel.
const HARDLY_TANGLED: f64 = 1.05;
const TANGLED: f64 = 1.26;
/// A finer reconstruction is tried where the best clean score is at most this many times that of a tangled winner.
const WITHIN_REACH: f64 = 1.27;
/// How much larger the score of a shape gets that is twice as far from the source as the closest one, as a part of it.
const DISTANCE_WEIGHT: f64 = 0.2;
/// As [`DISTANCE_WEIGHT`], for a shape all of whose faces pass through others.
const CROSSING_WEIGHT: f64 = 0.6;
/// As [`DISTANCE_WEIGHT`], for a shape with as many edges on its boundary as faces. Views that do not judge see cracks, and
/// vertices beside them have less room to be refined.
const BOUNDARY_WEIGHT: f64 = 0.2;
/// Handles that a shape may have and still count as one piece.
const FEW_HANDLES: i64 = 2;
/// Distances below this are equal, as a fraction of the diagonal of the source's bounding box.
const EQUAL_DISTANCE: f32 = 2e-5;

/// Whether the source's own triangles collapse to sound surfaces that are as good as any reconstruction:
/// finer ones would only come as close as they do.
pub(super) fn source_serves(contests: &[Contest]) -> bool {
    let is_sound = |contest: &Contest| contest.0.iter().any(|e| e.shape.road == Road::Source && !e.is_tangled());
    let wins = |contest: &Contest| {
        let scored = contest.0.iter().map(|entry| (entry.shape.road, contest.score(entry)));
        scored.min_by(|a, b| a.1.total_cmp(&b.1)).is_some_and(|(road, _)| road == Road::Source)
    };
    !contests.is_empty() && contests.iter().all(|contest| is_sound(contest) && wins(contest))
}

/// The shapes for a budget.
#[derive(Default)]
pub(super) struct Contest(Vec<Entry>);

/// A shape in a contest.
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
    /// Part of the faces that pass through others.
    fn tangled_part(&self) -> f64 {
        self.shape.self_intersecting as f64 / self.faces()
    }

    fn is_tangled(&self) -> bool {
        self.tangled_part() > MAY_INTERSECT
    }

    fn faces(&self) -> f64 {
        self.shape.mesh.triangles.len().max(1) as f64
    }

    fn distance(&self) -> f64 {
        f64::from(self.shape.deviation.mean.max(EQUAL_DISTANCE))
    }

    fn is_in_one_piece(&self) -> bool {
        self.topology.components == 1 && self.topology.euler_characteristic >= 2 - 2 * FEW_HANDLES && !self.is_tangled()
    }
}

impl Contest {
    pub(super) fn enter(&mut self, shape: Shape) {
        self.0.push(shape.into());
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a reconstruction is in pieces, has several handles or passes through itself: parts lie close together, and a
    /// thick surface may run around them.
    pub(super) fn wants_thick(&self) -> bool {
        let mut reconstructions = self.0.iter().filter(|entry| matches!(entry.shape.road, Road::Reconstruction(_)));
        !reconstructions.any(Entry::is_in_one_piece)
    }

    /// Whether a finer reconstruction may be free of the faces that pass through each other in the best shape.
    pub(super) fn wants_finer(&self) -> bool {
        let best = |tangled: bool| {
            let entries = self.0.iter().filter(|entry| entry.is_tangled() == tangled);
            entries.map(|entry| self.handicapped(entry)).fold(f64::INFINITY, f64::min)
        };
        let (clean, tangled) = (best(false), best(true));
        tangled < clean && tangled * WITHIN_REACH >= clean && self.finest_renders_best()
    }

    /// Whether of the reconstructions the finest renders best, and there are coarser ones.
    fn finest_renders_best(&self) -> bool {
        let reconstructions = self.0.iter().filter_map(|entry| match entry.shape.road {
            Road::Reconstruction(params) => Some((params.resolution, entry.shape.render_error)),
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

    /// The score with what a tangled shape has to be better by.
    fn handicapped(&self, entry: &Entry) -> f64 {
        if !entry.is_tangled() {
            return self.score(entry);
        }
        let part = (entry.tangled_part() - MAY_INTERSECT) / (TANGLED_THROUGH - MAY_INTERSECT);
        self.score(entry) * (HARDLY_TANGLED + (TANGLED - HARDLY_TANGLED) * part.min(1.0))
    }

    fn score(&self, entry: &Entry) -> f64 {
        let closest = self.0.iter().map(Entry::distance).fold(f64::INFINITY, f64::min);
        let boundary = entry.topology.edges.boundary as f64 / entry.faces();
        entry.shape.render_error
            * (1.0 + DISTANCE_WEIGHT * (entry.distance() / closest - 1.0))
            * (1.0 + CROSSING_WEIGHT * entry.tangled_part())
            * (1.0 + BOUNDARY_WEIGHT * boundary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriMesh;
    use crate::shape::Deviation;

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
            road: Road::Source,
            render_error,
            deviation: Deviation { mean, ..Deviation::default() },
            self_intersecting,
            cards: None,
        }
    }

    fn of<const N: usize>(shapes: [Shape; N]) -> Contest {
        Contest(shapes.into_iter().map(Entry::from).collect())
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
        let coarse = Road::Reconstruction(crate::reconstruct::Params::new(128));
        let contest = |reconstructed: f64, tangled: usize| {
            of([Shape { road: coarse, ..shape(reconstructed, 1e-3, 0) }, shape(1.0, 1e-3, tangled)])
        };
        assert!(source_serves(&[contest(1.1, 0), contest(1.2, 0)]));
        assert!(!source_serves(&[contest(1.2, 0), contest(0.8, 0)]));
        assert!(!source_serves(&[contest(1.2, 9), contest(1.2, 0)]));
        assert!(!source_serves(&[contest(0.8, 0), contest(1.2, 0)]));
        assert!(!source_serves(&[]));
    }

    #[test]
    fn a_thick_surface_is_wanted_around_parts_that_lie_close_together() {
        let coarse = Road::Reconstruction(crate::reconstruct::Params::new(128));
        let tetrahedron = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let with = |triangles: Vec<[u32; 3]>, tangled: usize| {
            let mesh = TriMesh { positions: vec![glam::Vec3::ZERO; 8], triangles };
            of([Shape { road: coarse, mesh, ..shape(1.0, 1e-3, tangled) }]).wants_thick()
        };
        assert!(!with(tetrahedron.to_vec(), 0));
        assert!(with(tetrahedron.to_vec(), 4));
        assert!(with(tetrahedron.iter().copied().chain(tetrahedron.map(|t| t.map(|v| v + 4))).collect(), 0));
    }

    #[test]
    fn a_finer_surface_is_wanted_where_it_may_untangle_the_winner_and_finer_ones_render_better() {
        let reconstructed = |cells: u32, error: f64| Shape {
            road: Road::Reconstruction(crate::reconstruct::Params::new(cells)),
            ..shape(error, 1e-3, 0)
        };
        let wanted = |coarse: f64, fine: f64, tangled: f64| {
            of([reconstructed(128, coarse), reconstructed(256, fine), shape(tangled, 1e-3, 9)]).wants_finer()
        };
        assert!(wanted(1.1, 1.0, 0.7) && !wanted(1.1, 1.0, 0.5) && !wanted(1.1, 1.0, 0.9));
        assert!(!wanted(1.0, 1.1, 0.7));
        assert!(!of([reconstructed(128, 1.0), shape(0.7, 1e-3, 9)]).wants_finer());
    }
}
