//! Planes in which many bars lie.

use glam::Vec3;

use super::lattice::Lattice;
use super::part::{Part, WIDTH};
use super::segment::segment_distance;
use crate::simplify::oriented_box::OrientedBox;

/// Fewest bars of a lattice.
const BARS: usize = 12;
/// Largest distance of a bar's ends from the plane, as a fraction of the radius of the bounding sphere. The larger one counts
/// where the smaller one leaves no lattice: spokes lie on a cone, but the layers of a truss are planes of their own.
const OFF_PLANE: [f32; 2] = [0.02, 0.035];
/// Planes are fitted to their bars so many times.
const FITS: usize = 4;
/// Largest distance between the axes of bars that belong together, in the same measure.
const GAP: f32 = 0.06;
/// Bars from which planes are tried in each round.
const SEEDS: usize = 150;
/// Neighbours of a bar with which it spans a plane.
const NEIGHBOURS: usize = 6;
/// What is about a bar is no further away than so many times half of its length: from a spoke, all of its wheel.
const ABOUT: f32 = 4.0;
/// More bars are a haystack.
const MOST_BARS: usize = 3000;
/// Bars beside one bar that count.
const MOST_BESIDE: usize = 16;
/// Sine of the least angle between bars that span a plane by their directions.
const ACROSS: f32 = 0.3;

/// The lattices among bars, at most `most`. The plane with the most triangles comes first, and takes its bars from the
/// others.
pub(super) fn planes_of_bars(bars: &[Part], radius: f32, most: usize) -> Vec<Lattice> {
    let mut lattices = Vec::new();
    if bars.len() > MOST_BARS {
        return lattices;
    }
    let mut planes = Planes { bars, radius, beside: beside(bars, GAP * radius), free: (0..bars.len()).collect() };
    while lattices.len() < most && planes.free.len() >= BARS {
        let Some(members) = OFF_PLANE.into_iter().find_map(|off_plane| planes.best(off_plane * radius)) else { break };
        let mut triangles: Vec<u32> = members.iter().flat_map(|&m| bars[m].triangles.iter().copied()).collect();
        triangles.sort_unstable();
        lattices.push(Lattice { triangles, bars: members.len() as u32 });
        planes.free.retain(|bar| !members.contains(bar));
    }
    lattices
}

/// For each bar, those that are within `gap`: of each bar, the nearest few.
fn beside(bars: &[Part], gap: f32) -> Vec<Vec<usize>> {
    let ends: Vec<[Vec3; 2]> = bars.iter().map(Part::ends).collect();
    let mut beside = vec![Vec::new(); bars.len()];
    for i in 0..bars.len() {
        let distances = (0..bars.len()).filter(|&j| j != i).map(|j| (segment_distance(ends[i], ends[j]), j));
        let mut near: Vec<(f32, usize)> = distances.filter(|(distance, _)| *distance <= gap).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, j) in near.into_iter().take(MOST_BESIDE) {
            beside[i].push(j);
            beside[j].push(i);
        }
    }
    beside
}

struct Planes<'a> {
    bars: &'a [Part],
    radius: f32,
    /// For each bar, those beside it.
    beside: Vec<Vec<usize>>,
    /// Bars of no lattice yet.
    free: Vec<usize>,
}

impl Planes<'_> {
    /// The bars of the plane with the most triangles. Their ends are within `off_plane` of it.
    fn best(&self, off_plane: f32) -> Option<Vec<usize>> {
        let stride = self.free.len().div_ceil(SEEDS);
        let mut best: Option<(usize, Vec<usize>)> = None;
        for &seed in self.free.iter().step_by(stride) {
            for normal in self.normals(seed) {
                let (members, normal) = self.fitted(seed, normal, off_plane);
                // What belongs together is at most all of it.
                let least = best.as_ref().map_or(0, |best| best.0);
                if members.len() < BARS || self.triangles(&members) <= least {
                    continue;
                }
                let members = self.together_with(seed, &members);
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
        let mut others: Vec<usize> = self.of_bone(seed).filter(|&i| i != seed).collect();
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

    /// Normals of planes through a bar that are tried: those that it spans with its neighbours, and that of all bars about
    /// it.
    fn normals(&self, seed: usize) -> Vec<Vec3> {
        let OrientedBox { centre, half, .. } = self.bars[seed].around;
        let is_about = |&i: &usize| self.bars[i].around.centre.distance(centre) <= ABOUT * half.x;
        let about: Vec<usize> = self.of_bone(seed).filter(is_about).collect();
        let spanned = self.neighbours(seed).into_iter().filter_map(|other| self.normal(seed, other));
        spanned.chain((about.len() >= BARS).then(|| self.plane_of(&about).1)).collect()
    }

    /// The bars of a plane through a bar that is fitted to them, and its normal.
    fn fitted(&self, seed: usize, normal: Vec3, off_plane: f32) -> (Vec<usize>, Vec3) {
        let mut best = (self.in_plane(seed, (self.bars[seed].around.centre, normal), off_plane), normal);
        for _ in 0..FITS {
            if best.0.len() < BARS {
                break;
            }
            let plane = self.plane_of(&best.0);
            let members = self.in_plane(seed, plane, off_plane);
            if members.binary_search(&seed).is_err() || self.triangles(&members) <= self.triangles(&best.0) {
                break;
            }
            best = (members, plane.1);
        }
        best
    }

    /// The centre and the normal of the plane through bars.
    fn plane_of(&self, members: &[usize]) -> (Vec3, Vec3) {
        let ends: Vec<Vec3> = members.iter().flat_map(|&m| self.bars[m].ends()).collect();
        let centre = ends.iter().sum::<Vec3>() / ends.len().max(1) as f32;
        (centre, OrientedBox::around(&ends).axes.z_axis)
    }

    /// The free bars on the bone of a bar in a plane, ascending.
    fn in_plane(&self, seed: usize, (origin, normal): (Vec3, Vec3), off_plane: f32) -> Vec<usize> {
        let is_near = |end: Vec3| (end - origin).dot(normal).abs() <= off_plane;
        self.of_bone(seed).filter(|&i| self.bars[i].ends().into_iter().all(is_near)).collect()
    }

    /// The free bars on the bone of a bar, with it.
    fn of_bone(&self, seed: usize) -> impl Iterator<Item = usize> {
        self.free.iter().copied().filter(move |&i| self.bars[i].bone == self.bars[seed].bone)
    }

    /// Those of the members that small gaps connect with the seed, ascending.
    fn together_with(&self, seed: usize, members: &[usize]) -> Vec<usize> {
        let mut is_open = vec![false; self.bars.len()];
        members.iter().for_each(|&m| is_open[m] = true);
        let (mut together, mut next) = (vec![seed], 0);
        is_open[seed] = false;
        while let Some(&bar) = together.get(next) {
            next += 1;
            for &other in &self.beside[bar] {
                if is_open[other] {
                    is_open[other] = false;
                    together.push(other);
                }
            }
        }
        together.sort_unstable();
        together
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
