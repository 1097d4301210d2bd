//! Where an edge collapses to, and at what error.

use glam::DVec3;

use super::{Entry, Simplifier};

/// Where `p` projects onto the edge from `a` to `b`, 0 to 1.
pub(super) fn part_of_way(a: DVec3, b: DVec3, p: DVec3) -> f64 {
    let way = b - a;
    ((p - a).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

impl Simplifier {
    /// Where the edge would best collapse to, and the error there.
    pub(super) fn placement(&self, u: u32, v: u32) -> (DVec3, f64) {
        let mut quadric = self.quadric(u);
        quadric.add(&self.quadric(v));
        let (a, b) = (self.positions[u as usize], self.positions[v as usize]);
        let (middle, length) = ((a + b) * 0.5, a.distance(b));
        // On flats, where every place is as good, short edges go first.
        let tie = 1e-9 * length.powi(4);
        let minimum = quadric.minimum().filter(|p| p.distance(middle) < 2.0 * length);
        if let Some(p) = minimum.filter(|_| self.in_motion.is_none()) {
            return (p, quadric.error(p) + tie);
        }
        let candidates = [minimum.unwrap_or(middle), middle, a, b].map(|p| (p, self.error_at(u, v, p)));
        let best = candidates.into_iter().reduce(|best, c| if c.1 < best.1 { c } else { best });
        best.map_or((middle, tie), |(p, error)| (p, error + tie))
    }

    /// Where an entry of the queue collapses to: the best place, or where that was refused the middle and the ends of the
    /// edge in the order of their errors.
    pub(super) fn place_of(&self, entry: &Entry) -> DVec3 {
        match entry.refused {
            0 => self.placement(entry.u, entry.v).0,
            refused => self.other_places(entry.u, entry.v)[refused as usize - 1].0,
        }
    }

    /// Puts an entry whose place was refused back at the error of its next place, if it has one.
    pub(super) fn push_next_place(&mut self, entry: &Entry) {
        if let Some(&(_, error)) = self.other_places(entry.u, entry.v).get(entry.refused as usize) {
            let cost = entry.cost.max(error as f32);
            self.queue.push(cost, Entry { cost, refused: entry.refused + 1, ..*entry });
        }
    }

    fn other_places(&self, u: u32, v: u32) -> [(DVec3, f64); 3] {
        let (a, b) = (self.positions[u as usize], self.positions[v as usize]);
        let mut places = [(a + b) * 0.5, a, b].map(|p| (p, self.error_at(u, v, p)));
        places.sort_by(|a, b| a.1.total_cmp(&b.1));
        places
    }

    /// Error of the edge `u v`, collapsed to `place`, at rest and in motion.
    fn error_at(&self, u: u32, v: u32, place: DVec3) -> f64 {
        let mut quadric = self.quadric(u);
        quadric.add(&self.quadric(v));
        let t = part_of_way(self.positions[u as usize], self.positions[v as usize], place);
        quadric.error(place) + self.in_motion.as_ref().map_or(0.0, |m| m.error(u, v, t, place))
    }
}
