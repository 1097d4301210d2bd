//! Collapses edges of a mesh of wedges onto one of their ends, the least error first.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use glam::{DVec3, Vec2};

use super::attributes::Values;
use super::quadric::AttributeQuadric;
use super::wedges::{LEAST_AREA, Wedge, WedgeMesh};
use crate::Cancellation;
use crate::geometry::{area_vector, face_components, group_by_component};
use crate::simplify::qem::Quadric;

/// Weight of the planes that hold borders, relative to that of the faces beside them.
const BORDER_WEIGHT: f64 = 3.0;
/// The same for seams of attributes and of materials.
const SEAM_WEIGHT: f64 = 1.0;
/// Least cosine of the angle by which a collapse turns a face.
const LEAST_COSINE: f64 = 0.2;
/// Area of a texture on a face, relative to that of the face, below which the face shows little more than one colour.
const FLAT_TEXTURE: f64 = 0.01;
/// Cost of a squared length: of collapses without an error the shortest come first.
const LENGTH_COST: f64 = 1e-12;
/// Collapses between two looks at the cancellation.
const CANCELLATION_STEPS: usize = 256;

/// Weights of each face: of its shape and of what it carries.
pub(super) struct FaceWeights {
    pub(super) shape: Vec<f64>,
    pub(super) attributes: Vec<f64>,
}

/// A mesh of wedges on its way down to a budget.
#[derive(Clone)]
pub(super) struct Reducer<'a> {
    pub(super) mesh: WedgeMesh,
    /// Positions of the points in the rest pose and in all others.
    poses: Vec<Vec<DVec3>>,
    /// For each point its quadric in each pose.
    shape: Vec<Quadric>,
    /// For each wedge.
    attributes: Vec<AttributeQuadric>,
    /// Weight of the shape of each face, for components that vanish.
    weights: Vec<f64>,
    /// Raised whenever a point changes.
    stamps: Vec<u32>,
    queue: BinaryHeap<Reverse<Queued>>,
    cancellation: &'a Cancellation,
}

/// The collapse of `u` onto `v`, ordered by its cost.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Queued {
    /// Bits of the cost, which is not negative.
    cost: u64,
    u: u32,
    v: u32,
    /// Stamps of both points when the entry was made.
    stamps: [u32; 2],
}

/// What a collapse does to the wedges of its point.
struct Plan {
    cost: f64,
    targets: Vec<(u32, Target)>,
}

/// What a wedge becomes.
#[derive(Clone, Copy, PartialEq)]
enum Target {
    /// A wedge of the other point.
    Wedge(u32),
    /// A new wedge of the other point.
    New(Values),
}

impl<'a> Reducer<'a> {
    /// `poses` are the positions of the points in further poses, in the unit sphere.
    pub(super) fn new(
        mesh: WedgeMesh,
        poses: Vec<Vec<DVec3>>,
        weights: FaceWeights,
        cancellation: &'a Cancellation,
    ) -> Self {
        let poses: Vec<Vec<DVec3>> = std::iter::once(mesh.positions.clone()).chain(poses).collect();
        let points = mesh.positions.len();
        let mut out = Self {
            shape: vec![Quadric::default(); points * poses.len()],
            attributes: vec![AttributeQuadric::default(); mesh.wedges.len()],
            weights: weights.shape,
            stamps: vec![0; points],
            queue: BinaryHeap::new(),
            mesh,
            poses,
            cancellation,
        };
        out.add_faces(&weights.attributes);
        out.add_creases();
        for u in 0..points as u32 {
            out.mesh.neighbours(u).into_iter().for_each(|v| out.push(u, v));
        }
        out
    }

    /// Collapses edges, and then removes the components that show least, until there are at most `faces` faces.
    pub(super) fn run(&mut self, faces: usize) {
        let mut steps = 0;
        while self.mesh.face_count() > faces {
            steps += 1;
            if steps % CANCELLATION_STEPS == 0 && self.cancellation.is_cancelled() {
                return;
            }
            let Some(Reverse(Queued { u, v, stamps, .. })) = self.queue.pop() else { break };
            if stamps != self.stamps_of(u, v) {
                continue;
            }
            if let Some(plan) = self.plan(u, v)
                && self.may_collapse(u, v, &plan)
            {
                self.collapse(u, v, plan);
            }
        }
        if self.mesh.face_count() > faces {
            self.remove_components(faces);
        }
    }

    /// Adds the planes of the faces in every pose, and their attributes.
    fn add_faces(&mut self, attribute_weights: &[f64]) {
        for f in self.mesh.live().collect::<Vec<_>>() {
            let (points, wedges) = (self.mesh.points(f), self.mesh.face(f));
            let weight = self.weights[f as usize];
            for pose in 0..self.poses.len() {
                let corners = points.map(|p| self.poses[pose][p as usize]);
                let n = area_vector(&corners).normalize_or_zero();
                let quadric = Quadric::plane(n, -n.dot(corners[0]), weight);
                points.into_iter().for_each(|p| self.shape_mut(p, pose).add(&quadric));
            }
            let corners = self.mesh.corners(f);
            let values = wedges.map(|w| &self.mesh.wedges[w as usize].values);
            let n = area_vector(&corners).normalize_or_zero();
            let quadric = AttributeQuadric::face(corners, n, values, attribute_weights[f as usize]);
            wedges.into_iter().for_each(|w| self.attributes[w as usize].add(&quadric));
        }
    }

    /// Adds planes through borders and seams, perpendicular to their faces, in every pose.
    fn add_creases(&mut self) {
        let mut edges: HashMap<[u32; 2], Vec<(u32, [u32; 2])>> = HashMap::new();
        for f in self.mesh.live() {
            let (points, wedges) = (self.mesh.points(f), self.mesh.face(f));
            for k in 0..3 {
                let [(a, wa), (b, wb)] = [k, (k + 1) % 3].map(|k| (points[k], wedges[k]));
                let (edge, sides) = if a < b { ([a, b], [wa, wb]) } else { ([b, a], [wb, wa]) };
                edges.entry(edge).or_default().push((f, sides));
            }
        }
        // In the order of the edges: sums over floats do not depend on a hash.
        let mut edges: Vec<_> = edges.into_iter().collect();
        edges.sort_unstable_by_key(|(edge, _)| *edge);
        for ([a, b], faces) in edges {
            let weight = match &faces[..] {
                [(_, one), (_, other)] if one == other => continue,
                [_, _] => SEAM_WEIGHT,
                _ => BORDER_WEIGHT,
            };
            faces.into_iter().for_each(|(f, _)| self.hold_edge(a, b, f, weight));
        }
    }

    fn hold_edge(&mut self, a: u32, b: u32, f: u32, weight: f64) {
        let points = self.mesh.points(f);
        let weight = weight * self.weights[f as usize];
        for pose in 0..self.poses.len() {
            let [pa, pb] = [a, b].map(|p| self.poses[pose][p as usize]);
            let area = area_vector(&points.map(|p| self.poses[pose][p as usize]));
            let n = (pb - pa).cross(area).normalize_or_zero();
            let quadric = Quadric::plane(n, -n.dot(pa), weight);
            [a, b].into_iter().for_each(|p| self.shape_mut(p, pose).add(&quadric));
        }
    }

    fn shape_mut(&mut self, point: u32, pose: usize) -> &mut Quadric {
        let poses = self.poses.len();
        &mut self.shape[point as usize * poses + pose]
    }

    fn shape_error(&self, u: u32, v: u32) -> f64 {
        let quadrics = &self.shape[u as usize * self.poses.len()..][..self.poses.len()];
        quadrics.iter().zip(&self.poses).map(|(quadric, pose)| quadric.error(pose[v as usize])).sum()
    }

    fn stamps_of(&self, u: u32, v: u32) -> [u32; 2] {
        [u, v].map(|p| self.stamps[p as usize])
    }

    fn push(&mut self, u: u32, v: u32) {
        if let Some(Plan { cost, .. }) = self.plan(u, v) {
            self.queue.push(Reverse(Queued { cost: cost.to_bits(), u, v, stamps: self.stamps_of(u, v) }));
        }
    }

    /// What the wedges of `u` become on `v`, and the error of it. `None` if they share no face.
    fn plan(&self, u: u32, v: u32) -> Option<Plan> {
        let p = self.mesh.positions[v as usize];
        let mut targets: Vec<(u32, Target)> = Vec::new();
        let mut errors: Vec<f64> = Vec::new();
        for &f in self.mesh.around(u) {
            let Some([from, to]) = self.mesh.wedges_at(f, u, v) else { continue };
            let error = self.attributes[from as usize].error(p, &self.mesh.wedges[to as usize].values);
            match targets.iter().position(|(wedge, _)| *wedge == from) {
                None => {
                    targets.push((from, Target::Wedge(to)));
                    errors.push(error);
                }
                // A seam ends at `u`.
                Some(i) if error < errors[i] => (targets[i].1, errors[i]) = (Target::Wedge(to), error),
                Some(_) => {}
            }
        }
        if targets.is_empty() {
            return None;
        }
        for &f in self.mesh.around(u) {
            let wedge = self.mesh.wedge_at(f, u)?;
            if !targets.iter().any(|(known, _)| *known == wedge) {
                let quadric = &self.attributes[wedge as usize];
                let values = quadric.best(p)?;
                targets.push((wedge, Target::New(values)));
                errors.push(quadric.error(p, &values));
            }
        }
        let length = LENGTH_COST * self.mesh.positions[u as usize].distance_squared(p);
        Some(Plan { cost: self.shape_error(u, v) + errors.iter().sum::<f64>() + length, targets })
    }

    /// The collapse turns no face over, and mirrors no texture. It may change the topology: what is thin becomes a sheet, and small
    /// components vanish.
    fn may_collapse(&self, u: u32, v: u32, plan: &Plan) -> bool {
        let mut kept = self.mesh.around(u).iter().filter(|&&f| !self.mesh.points(f).contains(&v));
        kept.all(|&f| self.keeps_side(f, u, v) && self.keeps_texture_side(f, plan))
    }

    /// A face shows the same side, with an area, if its point `u` moves to `v`.
    fn keeps_side(&self, f: u32, u: u32, v: u32) -> bool {
        let points = self.mesh.points(f);
        let before = area_vector(&self.mesh.corners(f));
        let moved = points.map(|p| self.mesh.positions[if p == u { v } else { p } as usize]);
        let after = area_vector(&moved);
        let (old, new) = (before.length(), after.length());
        new >= LEAST_AREA && before.dot(after) >= LEAST_COSINE * old * new
    }

    /// The texture on a face is not mirrored by a collapse.
    fn keeps_texture_side(&self, f: u32, plan: &Plan) -> bool {
        let before = self.mesh.face(f).map(|w| &self.mesh.wedges[w as usize].values);
        let after = self.mesh.face(f).map(|w| match plan.targets.iter().find(|(from, _)| *from == w) {
            Some((_, Target::Wedge(to))) => &self.mesh.wedges[*to as usize].values,
            Some((_, Target::New(values))) => values,
            None => &self.mesh.wedges[w as usize].values,
        });
        let [before, after] = [before, after].map(texture_area);
        // Where the texture hardly changes over a face, nobody sees its direction.
        f64::from(before.abs()) < FLAT_TEXTURE * area_vector(&self.mesh.corners(f)).length() || before * after > 0.0
    }

    fn collapse(&mut self, u: u32, v: u32, plan: Plan) {
        let mut targets = Vec::with_capacity(plan.targets.len());
        for (wedge, target) in plan.targets {
            let to = match target {
                Target::Wedge(to) => to,
                Target::New(values) => {
                    self.attributes.push(AttributeQuadric::default());
                    let old = self.mesh.wedges[wedge as usize].clone();
                    self.mesh.push(Wedge { point: v, values, is_new: true, ..old })
                }
            };
            let moved = self.attributes[wedge as usize].clone();
            self.attributes[to as usize].add(&moved);
            targets.push((wedge, to));
        }
        for pose in 0..self.poses.len() {
            let moved = *self.shape_mut(u, pose);
            self.shape_mut(v, pose).add(&moved);
        }
        let target = |wedge: u32| targets.iter().find(|(from, _)| *from == wedge).map_or(wedge, |(_, to)| *to);
        self.mesh.collapse(u, v, target);
        [u, v].into_iter().for_each(|p| self.stamps[p as usize] += 1);
        for other in self.mesh.neighbours(v) {
            self.push(v, other);
            self.push(other, v);
        }
    }

    /// Removes the components that show least for each of their faces, until there are at most `faces` faces.
    fn remove_components(&mut self, faces: usize) {
        let live: Vec<u32> = self.mesh.live().collect();
        let triangles: Vec<[u32; 3]> = live.iter().map(|&f| self.mesh.points(f)).collect();
        let components = group_by_component(&face_components(self.mesh.positions.len(), &triangles));
        let shown = |component: &[u32]| {
            let sum: f64 = component.iter().map(|&i| self.weights[live[i as usize] as usize]).sum();
            sum / component.len().max(1) as f64
        };
        let mut components: Vec<(f64, Vec<u32>)> = components.into_iter().map(|c| (shown(&c), c)).collect();
        components.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, component) in components {
            if self.mesh.face_count() <= faces {
                return;
            }
            component.into_iter().for_each(|i| self.mesh.remove(live[i as usize], None));
        }
    }
}

/// Twice the area of a face in the first set of texture coordinates; negative if it is mirrored.
fn texture_area(values: [&Values; 3]) -> f32 {
    let [a, b, c] = values.map(|values| Vec2::new(values[0], values[1]));
    (b - a).perp_dot(c - a)
}
