//! Which of several shapes for a budget is kept.
//!
//! Shapes are compared by what they render. A tenth of a decibel that a texture may paint over is worth neither a surface
//! twice as far from the source nor faces that pass through each other: both add to the score.

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
/// Handles that a shape may have and still count as one piece.
const FEW_HANDLES: i64 = 2;
/// Distances below this are equal, as a fraction of the diagonal of the source's bounding box.
const EQUAL_DISTANCE: f32 = 2e-5;

/// Whether the source's own triangles collapse to sound surfaces that are as good as any reconstruction:
/// finer ones would only come as close as they do.
pub(super) fn source_serves(contests: &[Contest]) -> bool {
    let is_sound = |contest: &Contest| contest.0.iter().any(|s| s.road == Road::Source && !is_tangled(s));
    let wins = |contest: &Contest| {
        let scored = contest.0.iter().map(|shape| (shape.road, contest.score(shape)));
        scored.min_by(|a, b| a.1.total_cmp(&b.1)).is_some_and(|(road, _)| road == Road::Source)
    };
    !contests.is_empty() && contests.iter().all(|contest| is_sound(contest) && wins(contest))
}

/// The shapes for a budget.
#[derive(Default)]
pub(super) struct Contest(Vec<Shape>);

impl Contest {
    pub(super) fn enter(&mut self, shape: Shape) {
        self.0.push(shape);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a reconstruction is in pieces, has several handles or passes through itself: parts lie close together, and a
    /// thick surface may run around them.
    pub(super) fn wants_thick(&self) -> bool {
        let in_one_piece = |shape: &Shape| {
            let topology = Topology::of(&shape.mesh);
            topology.components == 1 && topology.euler_characteristic >= 2 - 2 * FEW_HANDLES && !is_tangled(shape)
        };
        let mut reconstructions = self.0.iter().filter(|shape| matches!(shape.road, Road::Reconstruction(_)));
        !reconstructions.any(in_one_piece)
    }

    /// Whether a finer reconstruction may be free of the faces that pass through each other in the best shape.
    pub(super) fn wants_finer(&self) -> bool {
        let best = |tangled: bool| {
            let scores = self.0.iter().filter(|shape| is_tangled(shape) == tangled);
            scores.map(|shape| self.handicapped(shape)).fold(f64::INFINITY, f64::min)
        };
        let (clean, tangled) = (best(false), best(true));
        tangled < clean && tangled * WITHIN_REACH >= clean && self.finest_renders_best()
    }

    /// Whether of the reconstructions the finest renders best, and there are coarser ones.
    fn finest_renders_best(&self) -> bool {
        let reconstructions = self.0.iter().filter_map(|shape| match shape.road {
            Road::Reconstruction(params) => Some((params.resolution, shape.render_error)),
            _ => None,
        });
        let cells = || reconstructions.clone().map(|r| r.0);
        let best = reconstructions.clone().min_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0);
        best == cells().max() && best > cells().min()
    }

    /// The best shape.
    pub(super) fn into_best(self) -> Option<Shape> {
        let scores: Vec<f64> = self.0.iter().map(|shape| self.handicapped(shape)).collect();
        let candidates = self.0.into_iter().zip(scores);
        candidates.reduce(|best, next| if next.1 < best.1 { next } else { best }).map(|(shape, _)| shape)
    }

    /// The score with what a tangled shape has to be better by.
    fn handicapped(&self, shape: &Shape) -> f64 {
        if !is_tangled(shape) {
            return self.score(shape);
        }
        let part = (tangled_part(shape) - MAY_INTERSECT) / (TANGLED_THROUGH - MAY_INTERSECT);
        self.score(shape) * (HARDLY_TANGLED + (TANGLED - HARDLY_TANGLED) * part.min(1.0))
    }

    fn score(&self, shape: &Shape) -> f64 {
        let distance = |shape: &Shape| f64::from(shape.deviation.mean.max(EQUAL_DISTANCE));
        let closest = self.0.iter().map(distance).fold(f64::INFINITY, f64::min);
        shape.render_error
            * (1.0 + DISTANCE_WEIGHT * (distance(shape) / closest - 1.0))
            * (1.0 + CROSSING_WEIGHT * tangled_part(shape))
    }
}

/// Part of the faces that pass through others.
fn tangled_part(shape: &Shape) -> f64 {
    shape.self_intersecting as f64 / shape.mesh.triangles.len().max(1) as f64
}

fn is_tangled(shape: &Shape) -> bool {
    tangled_part(shape) > MAY_INTERSECT
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriMesh;
    use crate::shape::Deviation;

    fn shape(render_error: f64, mean: f32, self_intersecting: usize) -> Shape {
        Shape {
            mesh: TriMesh { positions: Vec::new(), triangles: vec![[0, 1, 2]; 100] },
            double_sided: false,
            road: Road::Source,
            render_error,
            deviation: Deviation { mean, ..Deviation::default() },
            self_intersecting,
            cards: None,
        }
    }

    fn winner(shapes: &[Shape]) -> f64 {
        let mut contest = Contest::default();
        shapes.iter().cloned().for_each(|shape| contest.enter(shape));
        contest.into_best().expect("one").render_error
    }

    #[test]
    fn the_better_picture_wins_unless_its_surface_is_much_farther_off() {
        assert_eq!(winner(&[shape(1.0, 1e-3, 0), shape(0.9, 1e-3, 0)]), 0.9);
        assert_eq!(winner(&[shape(1.0, 1e-3, 0), shape(0.9, 4e-3, 0)]), 1.0);
        assert_eq!(winner(&[shape(1.0, 0.0, 0), shape(0.9, 1e-5, 0)]), 0.9);
    }

    #[test]
    fn a_tangled_shape_wins_by_a_decibel_or_alone() {
        assert_eq!(winner(&[shape(1.0, 1e-3, 0), shape(0.85, 1e-3, 9)]), 1.0);
        assert_eq!(winner(&[shape(1.0, 1e-3, 1), shape(0.7, 1e-3, 9)]), 0.7);
        assert_eq!(winner(&[shape(0.85, 1e-3, 9)]), 0.85);
        assert_eq!(winner(&[shape(1.0, 1e-3, 0), shape(0.96, 1e-3, 2)]), 1.0);
        assert_eq!(winner(&[shape(1.0, 1e-3, 0), shape(0.85, 1e-3, 2)]), 0.85);
    }

    #[test]
    fn of_two_tangled_shapes_the_one_with_fewer_crossing_faces_may_render_worse() {
        assert_eq!(winner(&[shape(1.0, 1e-3, 50), shape(1.1, 1e-3, 10)]), 1.1);
        assert_eq!(winner(&[shape(1.0, 1e-3, 50), shape(1.1, 1e-3, 40)]), 1.0);
    }

    #[test]
    fn the_source_serves_where_it_is_sound_and_as_good() {
        let coarse = Road::Reconstruction(crate::reconstruct::Params::new(128));
        let contest = |reconstructed: f64, tangled: usize| {
            Contest(vec![Shape { road: coarse, ..shape(reconstructed, 1e-3, 0) }, shape(1.0, 1e-3, tangled)])
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
            Contest(vec![Shape { road: coarse, mesh, ..shape(1.0, 1e-3, tangled) }]).wants_thick()
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
            Contest(vec![reconstructed(128, coarse), reconstructed(256, fine), shape(tangled, 1e-3, 9)]).wants_finer()
        };
        assert!(wanted(1.1, 1.0, 0.7) && !wanted(1.1, 1.0, 0.5) && !wanted(1.1, 1.0, 0.9));
        assert!(!wanted(1.0, 1.1, 0.7));
        assert!(!Contest(vec![reconstructed(128, 1.0), shape(0.7, 1e-3, 9)]).wants_finer());
    }
}
