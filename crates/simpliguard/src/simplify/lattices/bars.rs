//! Planes in which many bars lie.

use glam::Vec3;

use super::lattice::Lattice;
use super::part::{Part, WIDTH};
use crate::geometry::DisjointSets;

/// Fewest bars of a lattice.
const BARS: usize = 12;
/// Largest distance of a bar's ends from the plane, as a fraction of the radius of the bounding sphere.
const OFF_PLANE: f32 = 0.02;
/// Largest distance between the axes of bars that belong together, in the same measure.
const GAP: f32 = 0.06;
/// Bars from which planes are tried in each round.
const SEEDS: usize = 150;
/// Neighbours of a bar with which it spans a plane.
const NEIGHBOURS: usize = 6;
/// More bars are a haystack.
const MOST_BARS: usize = 10_000;
/// Sine of the least angle between bars that span a plane by their directions.
const ACROSS: f32 = 0.3;

/// The lattices among bars, at most `most`. The plane with the most triangles comes first, and takes
/// its bars from the others.
pub(super) fn planes_of_bars(mut bars: Vec<Part>, radius: f32, most: usize) -> Vec<Lattice> {
    let mut lattices = Vec::new();
    if bars.len() > MOST_BARS {
        return lattices;
    }
    while lattices.len() < most && bars.len() >= BARS {
        let Some(members) = Planes { bars: &bars, radius }.best() else { break };
        let mut is_member = vec![false; bars.len()];
        members.iter().for_each(|&m| is_member[m] = true);
        let mut triangles: Vec<u32> = members.iter().flat_map(|&m| bars[m].triangles.iter().copied()).collect();
        triangles.sort_unstable();
        lattices.push(Lattice { triangles, bars: members.len() as u32 });
        let mut is_member = is_member.into_iter();
        bars.retain(|_| !is_member.next().unwrap_or(false));
    }
    lattices
}

struct Planes<'a> {
    bars: &'a [Part],
    radius: f32,
}

impl Planes<'_> {
    /// The bars of the plane with the most triangles.
    fn best(&self) -> Option<Vec<usize>> {
        let stride = self.bars.len().div_ceil(SEEDS);
        let mut best: Option<(usize, Vec<usize>)> = None;
        for seed in (0..self.bars.len()).step_by(stride) {
            for other in self.neighbours(seed) {
                let Some(normal) = self.normal(seed, other) else { continue };
                let members = self.in_plane(seed, normal);
                // What belongs together is at most all of it.
                let least = best.as_ref().map_or(0, |best| best.0);
                if members.len() < BARS || self.triangles(&members) <= least {
                    continue;
                }
                let members = self.together_with(seed, members);
                let triangles = self.triangles(&members);
                if members.len() >= BARS && triangles > least && self.is_wide(&members, normal) {
                    best = Some((triangles, members));
                }
            }
        }
        best.map(|best| best.1)
    }

    fn triangles(&self, members: &[usize]) -> usize {
        members.iter().map(|&m| self.bars[m].triangles.len()).sum()
    }

    /// The bars whose centres are nearest, on the same bone.
    fn neighbours(&self, seed: usize) -> Vec<usize> {
        let centre = self.bars[seed].around.centre;
        let is_other = |&i: &usize| i != seed && self.bars[i].bone == self.bars[seed].bone;
        let mut others: Vec<usize> = (0..self.bars.len()).filter(is_other).collect();
        let distance = |i: usize| self.bars[i].around.centre.distance_squared(centre);
        let order = |a: &usize, b: &usize| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b));
        if others.len() > NEIGHBOURS {
            others.select_nth_unstable_by(NEIGHBOURS, order);
            others.truncate(NEIGHBOURS);
        }
        others.sort_by(order);
        others
    }

    /// The normal of the plane of two bars.
    fn normal(&self, a: usize, b: usize) -> Option<Vec3> {
        let [(a, at_a), (b, at_b)] = [a, b].map(|i| (self.bars[i].around.axes.x_axis, self.bars[i].around.centre));
        let across = a.cross(b);
        let normal = if across.length() > ACROSS { across } else { a.cross(at_b - at_a) };
        normal.try_normalize()
    }

    fn in_plane(&self, seed: usize, normal: Vec3) -> Vec<usize> {
        let (origin, bone) = (self.bars[seed].around.centre, self.bars[seed].bone);
        let is_near = |end: Vec3| (end - origin).dot(normal).abs() <= OFF_PLANE * self.radius;
        let is_member = |&i: &usize| self.bars[i].bone == bone && self.bars[i].ends().into_iter().all(is_near);
        (0..self.bars.len()).filter(is_member).collect()
    }

    /// Those of the members that small gaps connect with the seed.
    fn together_with(&self, seed: usize, members: Vec<usize>) -> Vec<usize> {
        let mut sets = DisjointSets::new(members.len());
        let ends: Vec<[Vec3; 2]> = members.iter().map(|&m| self.bars[m].ends()).collect();
        for i in 0..members.len() {
            for j in 0..i {
                if sets.find(i) != sets.find(j) && segment_distance(ends[i], ends[j]) <= GAP * self.radius {
                    sets.join(i, j);
                }
            }
        }
        let roots = sets.roots();
        let place = members.iter().position(|&m| m == seed).unwrap_or(0);
        members.into_iter().zip(&roots).filter(|(_, root)| **root == roots[place]).map(|(m, _)| m).collect()
    }

    /// The bars spread in both directions of the plane.
    fn is_wide(&self, members: &[usize], normal: Vec3) -> bool {
        let x = self.bars[members[0]].around.axes.x_axis;
        let y = normal.cross(x);
        let spread = |axis: Vec3| {
            let along = members.iter().flat_map(|&m| self.bars[m].ends()).map(|end| end.dot(axis));
            let (low, high) = along.fold((f32::MAX, f32::MIN), |(low, high), p| (low.min(p), high.max(p)));
            high - low
        };
        spread(x).min(spread(y)) >= 2.0 * WIDTH * self.radius
    }
}

/// Distance between two segments (Ericson 2005, section 5.1.9).
fn segment_distance([p1, q1]: [Vec3; 2], [p2, q2]: [Vec3; 2]) -> f32 {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e, b) = (d1.length_squared(), d2.length_squared(), d1.dot(d2));
    let (c, f) = (d1.dot(r), d2.dot(r));
    let (a, e) = (a.max(f32::MIN_POSITIVE), e.max(f32::MIN_POSITIVE));
    let denominator = a * e - b * b;
    let s = if denominator > 0.0 { ((b * f - c * e) / denominator).clamp(0.0, 1.0) } else { 0.0 };
    let t = (b * s + f) / e;
    let (s, t) = if t < 0.0 {
        ((-c / a).clamp(0.0, 1.0), 0.0)
    } else if t > 1.0 {
        (((b - c) / a).clamp(0.0, 1.0), 1.0)
    } else {
        (s, t)
    };
    (p1 + d1 * s).distance(p2 + d2 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_segments() {
        let x = [Vec3::ZERO, Vec3::X];
        let cases = [
            ([Vec3::new(0.5, -1.0, 2.0), Vec3::new(0.5, 1.0, 2.0)], 2.0),
            ([Vec3::new(0.0, 3.0, 0.0), Vec3::new(1.0, 3.0, 0.0)], 3.0),
            ([Vec3::new(2.0, 0.0, 0.0), Vec3::new(5.0, 0.0, 0.0)], 1.0),
            ([Vec3::new(1.0, 1.0, 0.0), Vec3::new(4.0, 4.0, 0.0)], 1.0),
        ];
        for (other, distance) in cases {
            assert!((segment_distance(x, other) - distance).abs() < 1e-6, "{other:?}");
            assert!((segment_distance(other, x) - distance).abs() < 1e-6, "{other:?}");
        }
    }
}
