//! The position to which an edge collapses, and the error there.

use glam::DVec3;

use super::simplifier::{QueuedCollapse, Simplifier};

/// Parameter of the projection of `p` on the edge from `a` to `b`: 0 at `a`, 1 at `b`, clamped between them.
pub(super) fn edge_parameter(a: DVec3, b: DVec3, p: DVec3) -> f64 {
    let edge = b - a;
    ((p - a).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

impl Simplifier {
    /// The best position for the collapse of the edge `u v`, and its cost.
    pub(super) fn placement(&self, u: u32, v: u32) -> (DVec3, f64) {
        let quadric = self.edge_quadric(u, v);
        let (a, b) = (self.positions[u as usize], self.positions[v as usize]);
        let (middle, length) = ((a + b) * 0.5, a.distance(b));
        // On flats, where every position is as good, short edges collapse first.
        let tie = 1e-9 * length.powi(4);
        let minimum = quadric.minimum().filter(|p| p.distance(middle) < 2.0 * length);
        if let Some(p) = minimum.filter(|_| self.posed.is_none()) {
            return (p, quadric.error(p) + tie);
        }
        let candidates = [minimum.unwrap_or(middle), middle, a, b].map(|p| (p, self.error_at(u, v, p)));
        let best = candidates.into_iter().reduce(|best, c| if c.1 < best.1 { c } else { best });
        best.map_or((middle, tie), |(p, error)| (p, error + tie))
    }

    /// The position for an entry of the queue: the best one or, if that was refused, the middle and the ends of the
    /// edge in the order of their errors.
    pub(super) fn position_of(&self, entry: &QueuedCollapse) -> DVec3 {
        match entry.refused {
            0 => self.placement(entry.u, entry.v).0,
            refused => self.fallback_positions(entry.u, entry.v)[refused as usize - 1].0,
        }
    }

    /// Pushes an entry whose position was refused again, at the error of its next position, if it has one.
    pub(super) fn push_next_position(&mut self, entry: &QueuedCollapse) {
        if let Some(&(_, error)) = self.fallback_positions(entry.u, entry.v).get(entry.refused as usize) {
            let cost = entry.cost.max(error as f32);
            self.queue.push(cost, QueuedCollapse { cost, refused: entry.refused + 1, ..*entry });
        }
    }

    fn fallback_positions(&self, u: u32, v: u32) -> [(DVec3, f64); 3] {
        let (a, b) = (self.positions[u as usize], self.positions[v as usize]);
        let mut positions = [(a + b) * 0.5, a, b].map(|p| (p, self.error_at(u, v, p)));
        positions.sort_by(|a, b| a.1.total_cmp(&b.1));
        positions
    }

    /// Error of the edge `u v`, collapsed to `position`, in the rest pose and in motion.
    fn error_at(&self, u: u32, v: u32, position: DVec3) -> f64 {
        let t = edge_parameter(self.positions[u as usize], self.positions[v as usize], position);
        let in_motion = self.posed.as_ref().map_or(0.0, |posed| posed.error(u, v, t, position));
        self.edge_quadric(u, v).error(position) + in_motion
    }
}
