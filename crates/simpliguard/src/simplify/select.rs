//! Selects the best of several shapes for a budget.
//!
//! The score of a shape is its render error, raised by its distance to the source, its self-intersecting faces and its
//! cracks; the lowest score wins. So a gain of a tenth of a decibel, which a texture may paint over, cannot make up for
//! any of them.

use super::shape::{RunnerUp, Selected, Shape};
use crate::data::Candidate;
use crate::geometry::Topology;
use crate::geometry::self_intersection::{SEVERE, TOLERATED};

/// Factor on the score of a shape that exceeds the tolerated self-intersections only just.
const SLIGHT_HANDICAP: f64 = 1.05;
/// Factor on the score of a severely self-intersecting shape: one decibel.
const FULL_HANDICAP: f64 = 1.26;
/// A finer reconstruction is generated if the best clean score is at most this many times the score of a
/// self-intersecting winner.
const WITHIN_REACH: f64 = 1.27;
/// A shape that is twice as far from the source as the closest shape has its score raised by this fraction.
const DISTANCE_WEIGHT: f64 = 0.2;
/// A shape of which all faces are self-intersecting has its score raised by this fraction.
const INTERSECTION_WEIGHT: f64 = 0.6;
/// A shape with as many boundary edges as faces has its score raised by this fraction. Other views than those that
/// score may show the cracks, and vertices beside them have less room to be refined.
const BOUNDARY_WEIGHT: f64 = 0.2;
/// Handles that a shape may have and still count as one piece.
const FEW_HANDLES: i64 = 2;
/// Distances below this are equal, as a fraction of the diagonal of the source's bounding box.
const EQUAL_DISTANCE: f32 = 2e-5;

/// True if the source's own triangles collapse, for every budget, to a clean surface that scores as well as any
/// reconstruction. Finer reconstructions can only come closer to the same surface then.
pub(super) fn source_serves(selections: &[Selection]) -> bool {
    let is_clean = |selection: &Selection| {
        selection.0.iter().any(|c| c.shape.candidate == Candidate::Source && !c.self_intersects())
    };
    let wins = |selection: &Selection| {
        let scored = selection.0.iter().map(|contestant| (contestant.shape.candidate, selection.score(contestant)));
        scored.min_by(|a, b| a.1.total_cmp(&b.1)).is_some_and(|(candidate, _)| candidate == Candidate::Source)
    };
    !selections.is_empty() && selections.iter().all(|selection| is_clean(selection) && wins(selection))
}

/// The shapes for one budget.
#[derive(Default)]
pub(super) struct Selection(Vec<Contestant>);

/// A shape in the selection, and its topology.
struct Contestant {
    shape: Shape,
    topology: Topology,
}

impl From<Shape> for Contestant {
    fn from(shape: Shape) -> Self {
        Self { topology: Topology::of(&shape.mesh), shape }
    }
}

impl Contestant {
    /// Fraction of the faces that are self-intersecting.
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

    /// True if no reconstruction is in one piece, with few handles and clean. Components of the source lie close
    /// together then, and a thick surface may enclose them.
    pub(super) fn wants_thick(&self) -> bool {
        let mut reconstructions =
            self.0.iter().filter(|contestant| matches!(contestant.shape.candidate, Candidate::Reconstruction(_)));
        !reconstructions.any(Contestant::is_in_one_piece)
    }

    /// True if the best shape intersects itself and a finer reconstruction may score as well without.
    pub(super) fn wants_finer(&self) -> bool {
        let best = |self_intersecting: bool| {
            let contestants = self.0.iter().filter(|contestant| contestant.self_intersects() == self_intersecting);
            contestants.map(|contestant| self.handicapped(contestant)).fold(f64::INFINITY, f64::min)
        };
        let (clean, self_intersecting) = (best(false), best(true));
        self_intersecting < clean && self_intersecting * WITHIN_REACH >= clean && self.finest_renders_best()
    }

    /// True if the finest of several reconstructions has the least render error.
    fn finest_renders_best(&self) -> bool {
        let reconstructions = self.0.iter().filter_map(|contestant| match contestant.shape.candidate {
            Candidate::Reconstruction(params) => Some((params.resolution, contestant.shape.render_error)),
            _ => None,
        });
        let cells = || reconstructions.clone().map(|r| r.0);
        let best = reconstructions.clone().min_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0);
        best == cells().max() && best > cells().min()
    }

    /// The shape with the lowest score, handicap included, and the best of the other kind.
    pub(super) fn into_selected(self) -> Option<Selected> {
        let scores: Vec<f64> = self.0.iter().map(|contestant| self.handicapped(contestant)).collect();
        let mut ranked: Vec<(Contestant, f64)> = self.0.into_iter().zip(scores).collect();
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut ranked = ranked.into_iter().map(|(contestant, score)| (contestant.shape, score));
        let is_reconstruction = |shape: &Shape| matches!(shape.candidate, Candidate::Reconstruction(_));
        let (best, best_score) = ranked.next()?;
        let runner_up = ranked
            .find(|(shape, _)| is_reconstruction(shape) != is_reconstruction(&best))
            .map(|(shape, score)| RunnerUp { shape, relative_score: score / best_score.max(f64::MIN_POSITIVE) });
        Some(Selected { best, runner_up })
    }

    /// The score, with the handicap if the shape intersects itself.
    fn handicapped(&self, contestant: &Contestant) -> f64 {
        if !contestant.self_intersects() {
            return self.score(contestant);
        }
        let severity = (contestant.self_intersecting_fraction() - TOLERATED) / (SEVERE - TOLERATED);
        self.score(contestant) * (SLIGHT_HANDICAP + (FULL_HANDICAP - SLIGHT_HANDICAP) * severity.min(1.0))
    }

    fn score(&self, contestant: &Contestant) -> f64 {
        let closest = self.0.iter().map(Contestant::distance).fold(f64::INFINITY, f64::min);
        let boundary = contestant.topology.edges.boundary as f64 / contestant.faces();
        contestant.shape.render_error
            * (1.0 + DISTANCE_WEIGHT * (contestant.distance() / closest - 1.0))
            * (1.0 + INTERSECTION_WEIGHT * contestant.self_intersecting_fraction())
            * (1.0 + BOUNDARY_WEIGHT * boundary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Deviation, TriMesh};
    use crate::simplify::shape::Shortfall;

    /// Twenty-five closed components of four faces.
    fn tetrahedra() -> TriMesh {
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let triangles = (0..25u32).flat_map(|i| faces.map(|face| face.map(|v| v + 4 * i))).collect();
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
        Selection(shapes.into_iter().map(Contestant::from).collect())
    }

    fn winner<const N: usize>(shapes: [Shape; N]) -> f64 {
        of(shapes).into_selected().expect("one").best.render_error
    }

    #[test]
    fn the_better_image_wins_unless_its_surface_is_much_farther_off() {
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.9, 1e-3, 0)]), 0.9);
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.9, 4e-3, 0)]), 1.0);
        assert_eq!(winner([shape(1.0, 0.0, 0), shape(0.9, 1e-5, 0)]), 0.9);
    }

    #[test]
    fn the_runner_up_is_the_best_of_the_other_kind() {
        let reconstructed = |error: f64| Shape {
            candidate: Candidate::Reconstruction(crate::data::Reconstruction::new(128)),
            ..shape(error, 1e-3, 0)
        };
        let errors = |shapes: Vec<Shape>| {
            let contestants = shapes.into_iter().map(Contestant::from).collect();
            let Selected { best, runner_up } = Selection(contestants).into_selected().expect("one");
            (
                best.render_error,
                runner_up.map(|RunnerUp { shape, relative_score }| (shape.render_error, relative_score)),
            )
        };
        let own = |error: f64| shape(error, 1e-3, 0);
        assert_eq!(errors(vec![own(1.0), reconstructed(1.3), own(1.1), reconstructed(1.2)]), (1.0, Some((1.2, 1.2))));
        assert_eq!(errors(vec![own(1.0), reconstructed(0.5)]), (0.5, Some((1.0, 2.0))));
        assert_eq!(errors(vec![own(1.0), own(1.1)]), (1.0, None));
    }

    #[test]
    fn a_self_intersecting_shape_wins_by_a_decibel_or_alone() {
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.85, 1e-3, 9)]), 1.0);
        assert_eq!(winner([shape(1.0, 1e-3, 1), shape(0.7, 1e-3, 9)]), 0.7);
        assert_eq!(winner([shape(0.85, 1e-3, 9)]), 0.85);
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.96, 1e-3, 2)]), 1.0);
        assert_eq!(winner([shape(1.0, 1e-3, 0), shape(0.85, 1e-3, 2)]), 0.85);
    }

    #[test]
    fn of_two_self_intersecting_shapes_the_cleaner_one_may_render_worse() {
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
    fn a_thick_surface_is_wanted_around_components_that_lie_close_together() {
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
    fn a_finer_surface_is_wanted_where_it_may_be_clean_and_finer_ones_render_better() {
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
