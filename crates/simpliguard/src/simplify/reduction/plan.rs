//! What a collapse would do, and what it would cost.

use glam::{DVec3, Vec2};

use super::attributes::Values;
use super::quadric::AttributeQuadric;
use super::reducer::Reducer;
use super::wedges::LEAST_AREA;
use crate::geometry::area_vector;
use crate::simplify::qem::Quadric;

/// Least cosine of the angle by which a collapse turns a face.
const LEAST_COSINE: f64 = 0.2;
/// Area of a texture on a face, relative to that of the face, below which the face shows little more than one colour.
const FLAT_TEXTURE: f64 = 0.01;
/// Cost of a squared length: of collapses without an error the shortest come first.
const LENGTH_COST: f64 = 1e-12;
/// A new place has to cost less than this fraction of the old ones: there, attributes are exact.
const WORTH_A_PLACE: f64 = 0.9;
/// Largest distance of a new place from the middle of its edge, in lengths of the edge.
const FARTHEST: f64 = 1.0;

/// A collapse of the point `u` into `v`.
pub(super) struct Plan {
    pub(super) u: u32,
    pub(super) v: u32,
    /// The rise of the sum of all errors, not negative.
    pub(super) cost: f64,
    /// Where `v` is then; `None` if it stays.
    pub(super) place: Option<DVec3>,
    /// What becomes of each wedge of `u`.
    pub(super) targets: Vec<(u32, Target)>,
    /// The values of the wedges of `v`, if it moves.
    pub(super) values: Vec<(u32, Values)>,
}

/// What a wedge becomes.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Target {
    /// A wedge of the other point.
    Wedge(u32),
    /// A new wedge of the other point.
    New(Values),
}

impl Reducer<'_> {
    /// The collapses of an edge, the cheapest first: onto each of its ends and, if points may move, into the place of the least
    /// error. Empty if the points share no face.
    pub(super) fn plans(&self, u: u32, v: u32) -> Vec<Plan> {
        let mut plans: Vec<Plan> = [(u, v), (v, u)].into_iter().filter_map(|(u, v)| self.plan_onto(u, v)).collect();
        let least = plans.iter().map(|plan| plan.cost).fold(f64::INFINITY, f64::min);
        let placed = self.may_place.then(|| self.plan_placed(u, v)).flatten();
        plans.extend(placed.filter(|plan| plan.cost < WORTH_A_PLACE * least));
        plans.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        plans
    }

    /// The collapse of `u` onto `v`.
    fn plan_onto(&self, u: u32, v: u32) -> Option<Plan> {
        let p = self.mesh.positions[v as usize];
        let mut targets = self.wedge_pairs(u, v);
        if targets.is_empty() {
            return None;
        }
        let mut error = self.shape_error(u, v);
        for (from, to) in &targets {
            error += self.attributes[*from as usize].error(p, &self.mesh.wedges[*to as usize].values);
        }
        let mut targets: Vec<(u32, Target)> = targets.drain(..).map(|(from, to)| (from, Target::Wedge(to))).collect();
        for wedge in self.mesh.wedges_of(u) {
            if !targets.iter().any(|(known, _)| *known == wedge) {
                let quadric = &self.attributes[wedge as usize];
                let values = quadric.best(p)?;
                error += quadric.error(p, &values);
                targets.push((wedge, Target::New(values)));
            }
        }
        let cost = self.cost(u, v, error - self.paid(u));
        Some(Plan { u, v, cost, place: None, targets, values: Vec::new() })
    }

    /// The collapse of `u` into `v` at the place of the least error, where all attributes are those that suit the faces best.
    fn plan_placed(&self, u: u32, v: u32) -> Option<Plan> {
        let mut shape: Quadric = self.shape[u as usize];
        shape.add(&self.shape[v as usize]);
        let p = shape.minimum()?;
        let [a, b] = [u, v].map(|point| self.mesh.positions[point as usize]);
        if p.distance(0.5 * (a + b)) > FARTHEST * a.distance(b) {
            return None;
        }
        let (pairs, mut error) = (self.wedge_pairs(u, v), shape.error(p));
        let mut best = |quadric: &AttributeQuadric| {
            let values = quadric.best(p)?;
            error += quadric.error(p, &values);
            Some(values)
        };
        let (mut targets, mut values) = (Vec::new(), Vec::new());
        for wedge in self.mesh.wedges_of(v) {
            let mut quadric = self.attributes[wedge as usize].clone();
            for (from, _) in pairs.iter().filter(|(_, to)| *to == wedge) {
                quadric.add(&self.attributes[*from as usize]);
            }
            values.push((wedge, best(&quadric)?));
        }
        for wedge in self.mesh.wedges_of(u) {
            let target = match pairs.iter().find(|(from, _)| *from == wedge) {
                Some((_, to)) => Target::Wedge(*to),
                None => Target::New(best(&self.attributes[wedge as usize])?),
            };
            targets.push((wedge, target));
        }
        let cost = self.cost(u, v, error - self.paid(u) - self.paid(v));
        Some(Plan { u, v, cost, place: Some(p), targets, values })
    }

    /// The wedge of `v` for each wedge of `u` that shares a face with one. Where a seam ends at `u`, it is that of less error.
    fn wedge_pairs(&self, u: u32, v: u32) -> Vec<(u32, u32)> {
        let p = self.mesh.positions[v as usize];
        let error = |from: u32, to: u32| self.attributes[from as usize].error(p, &self.mesh.wedges[to as usize].values);
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        for &f in self.mesh.around(u) {
            let Some([from, to]) = self.mesh.wedges_at(f, u, v) else { continue };
            match pairs.iter_mut().find(|(wedge, _)| *wedge == from) {
                None => pairs.push((from, to)),
                Some((_, known)) if *known != to && error(from, to) < error(from, *known) => *known = to,
                Some(_) => {}
            }
        }
        pairs
    }

    fn cost(&self, u: u32, v: u32, rise: f64) -> f64 {
        let [a, b] = [u, v].map(|point| self.mesh.positions[point as usize]);
        rise.max(0.0) + LENGTH_COST * a.distance_squared(b)
    }

    /// The error that a point has already.
    fn paid(&self, point: u32) -> f64 {
        let p = self.mesh.positions[point as usize];
        let of_wedge = |w: u32| self.attributes[w as usize].error(p, &self.mesh.wedges[w as usize].values);
        self.shape_error(point, point) + self.mesh.wedges_of(point).into_iter().map(of_wedge).sum::<f64>()
    }

    /// The error of the shape of `u` at the place of `v`, over all poses.
    fn shape_error(&self, u: u32, v: u32) -> f64 {
        let quadrics = &self.shape[u as usize * self.poses.len()..][..self.poses.len()];
        quadrics.iter().zip(&self.poses).map(|(quadric, pose)| quadric.error(pose[v as usize])).sum()
    }

    /// A collapse turns no face over, and mirrors no texture. It may change the topology: what is thin becomes a sheet, and small
    /// components vanish.
    pub(super) fn is_allowed(&self, plan: &Plan) -> bool {
        let Plan { u, v, place, .. } = *plan;
        let has = |f: u32, point: u32| self.mesh.points(f).contains(&point);
        let keeps = |f: u32| self.keeps_side(f, plan) && self.keeps_texture_side(f, plan);
        let of_u = self.mesh.around(u).iter().filter(|&&f| !has(f, v)).all(|&f| keeps(f));
        of_u && (place.is_none() || self.mesh.around(v).iter().filter(|&&f| !has(f, u)).all(|&f| keeps(f)))
    }

    /// A face shows the same side, with an area.
    fn keeps_side(&self, f: u32, plan: &Plan) -> bool {
        let place = plan.place.unwrap_or(self.mesh.positions[plan.v as usize]);
        let before = self.mesh.corners(f);
        let mut after = before;
        for (corner, point) in after.iter_mut().zip(self.mesh.points(f)) {
            if point == plan.u || point == plan.v {
                *corner = place;
            }
        }
        let [before, after] = [before, after].map(|corners| area_vector(&corners));
        let (old, new) = (before.length(), after.length());
        new >= LEAST_AREA && before.dot(after) >= LEAST_COSINE * old * new
    }

    /// The texture on a face is not mirrored.
    fn keeps_texture_side(&self, f: u32, plan: &Plan) -> bool {
        let values = |w: u32| &self.mesh.wedges[w as usize].values;
        let of_v = |w: u32| plan.values.iter().find(|(of, _)| *of == w).map_or(values(w), |(_, new)| new);
        let after = self.mesh.face(f).map(|w| match plan.targets.iter().find(|(from, _)| *from == w) {
            Some((_, Target::Wedge(to))) => of_v(*to),
            Some((_, Target::New(values))) => values,
            None => of_v(w),
        });
        let [before, after] = [self.mesh.face(f).map(values), after].map(texture_area);
        // Where the texture hardly changes over a face, nobody sees its direction.
        f64::from(before.abs()) < FLAT_TEXTURE * area_vector(&self.mesh.corners(f)).length() || before * after > 0.0
    }
}

/// Twice the area of a face in the first set of texture coordinates; negative if it is mirrored.
fn texture_area(values: [&Values; 3]) -> f32 {
    let [a, b, c] = values.map(|values| Vec2::new(values[0], values[1]));
    (b - a).perp_dot(c - a)
}
