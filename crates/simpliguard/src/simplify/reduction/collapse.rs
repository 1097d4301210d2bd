//! Collapses the edges of a mesh of wedges, the least error first.

use std::cmp::Reverse;

use super::plan::{Plan, Target};
use super::quadric::AttributeQuadric;
use super::reducer::{Queued, Reducer};
use super::wedges::Wedge;
use crate::geometry::{face_components, group_by_component};

/// Collapses between two looks at the cancellation.
const CANCELLATION_STEPS: usize = 256;

impl Reducer<'_> {
    /// Collapses edges, and then removes the components that show least, until there are at most `faces` faces.
    pub(super) fn run(&mut self, faces: usize) {
        let mut steps = 0;
        while self.mesh.face_count() > faces {
            steps += 1;
            if steps % CANCELLATION_STEPS == 0 && self.cancellation.is_cancelled() {
                return;
            }
            let Some(Reverse(Queued { u, v, refused, stamps, .. })) = self.queue.pop() else { break };
            if stamps != self.stamps_of(u, v) {
                continue;
            }
            match self.plans(u, v).into_iter().nth(refused) {
                Some(plan) if self.is_allowed(&plan) => self.collapse(plan),
                Some(_) => self.push(u, v, refused + 1),
                None => {}
            }
        }
        if self.mesh.face_count() > faces {
            self.remove_components(faces);
        }
    }

    /// Queues an edge of which so many collapses were refused.
    pub(super) fn push(&mut self, u: u32, v: u32, refused: usize) {
        if let Some(plan) = self.plans(u, v).get(refused) {
            let stamps = self.stamps_of(u, v);
            self.queue.push(Reverse(Queued { cost: plan.cost.to_bits(), u, v, refused, stamps }));
        }
    }

    fn collapse(&mut self, plan: Plan) {
        let Plan { u, v, place, targets, values, .. } = plan;
        let mut replaced = Vec::with_capacity(targets.len());
        for (wedge, target) in targets {
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
            replaced.push((wedge, to));
        }
        for (wedge, values) in values {
            let wedge = &mut self.mesh.wedges[wedge as usize];
            (wedge.values, wedge.is_new) = (values, true);
        }
        for pose in 0..self.poses.len() {
            let moved = *self.shape_mut(u, pose);
            self.shape_mut(v, pose).add(&moved);
        }
        let target = |wedge: u32| replaced.iter().find(|(from, _)| *from == wedge).map_or(wedge, |(_, to)| *to);
        self.mesh.collapse(u, v, target);
        if let Some(place) = place {
            self.mesh.place(v, place);
            self.poses[0][v as usize] = place;
        }
        [u, v].into_iter().for_each(|p| self.stamps[p as usize] += 1);
        self.mesh.neighbours(v).into_iter().for_each(|other| self.push(v.min(other), v.max(other), 0));
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
