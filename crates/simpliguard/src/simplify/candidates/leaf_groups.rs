//! Groups of leaves, each of which one flat card shows.
//!
//! A card shows its leaves well where they lie near one plane and along it. So the error of a group is the least, over all
//! planes through its centre, of the squared distances to the plane, together with how far the faces turn away from it: both
//! are quadratic in the normal, and sums over the leaves of a group (the metrics L2 and L2,1 of variational shape
//! approximation, Cohen-Steiner et al. 2004, for planes without an orientation). Groups are halved where that reduces the
//! error most, and then their leaves move to the group whose plane suits them best, as in Lloyd's method.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::iter::Sum;

use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use crate::simplify::oriented_box::principal_axes;

/// Weight of the directions of faces beside that of distances, which count in multiples of the size of a leaf.
const TURN: f64 = 1.0;
/// Weight of the distances along the plane: compact groups leave fewer gaps on their cards.
const SPREAD: f64 = 0.05;
/// Fractions of a group's weight at which it may be divided.
const CUTS: [f64; 3] = [0.3, 0.5, 0.7];
/// Rounds in which leaves move to the group that suits them best.
const ROUNDS: usize = 4;

/// Sums over triangles, by their weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moments {
    weight: f64,
    sum: DVec3,
    /// Sum of outer products of positions.
    squares: DMat3,
    /// Sum of outer products of unit normals.
    normals: DMat3,
}

impl Moments {
    /// Those of nothing.
    const ZERO: Self = Self { weight: 0.0, sum: DVec3::ZERO, squares: DMat3::ZERO, normals: DMat3::ZERO };

    /// Those of a triangle of this weight.
    pub(super) fn of_triangle(corners: [Vec3; 3], weight: f64) -> Self {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let centre = (a + b + c) / 3.0;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let squares = [a, b, c].map(outer).into_iter().fold(outer(centre) * 9.0, |sum, m| sum + m) * (1.0 / 12.0);
        Self { weight, sum: centre * weight, squares: squares * weight, normals: outer(normal) * weight }
    }

    fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.sum += other.sum;
        self.squares += other.squares;
        self.normals += other.normals;
    }

    fn less(&self, other: &Self) -> Self {
        Self {
            weight: self.weight - other.weight,
            sum: self.sum - other.sum,
            squares: self.squares - other.squares,
            normals: self.normals - other.normals,
        }
    }

    /// The mean square of the cosine between the triangles' normals and the direction that they face most.
    pub(super) fn flatness(&self) -> f64 {
        let normal = axes(self.normals).x_axis;
        normal.dot(self.normals * normal) / self.weight.max(f64::MIN_POSITIVE)
    }

    fn centre(&self) -> DVec3 {
        self.sum / self.weight.max(f64::MIN_POSITIVE)
    }

    /// Weight times covariance of the positions.
    fn scatter(&self) -> DMat3 {
        self.squares - outer(self.centre()) * self.weight
    }

    /// The matrix whose quadratic form of a unit normal is the error of the plane, but for a constant.
    fn form(&self, size: f64) -> DMat3 {
        self.scatter() * (1.0 / (size * size)) - self.normals * TURN
    }

    /// The plane of least error, and the error.
    fn plane(&self, size: f64) -> (Plane, f64) {
        let form = self.form(size);
        let normal = axes(form).z_axis;
        let scatter = self.scatter();
        let trace = scatter.x_axis.x + scatter.y_axis.y + scatter.z_axis.z;
        let error = normal.dot(form * normal) + TURN * self.weight + SPREAD * trace / (size * size);
        (Plane { centre: self.centre(), normal }, error)
    }
}

impl Sum for Moments {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::ZERO, |mut sum, part| {
            sum.add(&part);
            sum
        })
    }
}

/// Leaves that one card shows, and its plane.
#[derive(Clone, Debug)]
pub(super) struct LeafGroup {
    pub(super) leaves: Vec<u32>,
    /// A point of the plane.
    pub(super) centre: Vec3,
    pub(super) normal: Vec3,
}

/// The plane of a card.
#[derive(Clone, Copy, Debug)]
struct Plane {
    centre: DVec3,
    normal: DVec3,
}

impl Plane {
    /// The error of a leaf beside this plane. The leaf's own extent counts for any plane alike.
    fn error(&self, leaf: &Moments, size: f64) -> f64 {
        let offset = (leaf.centre() - self.centre) / size;
        let across = offset.dot(self.normal);
        let turned = leaf.weight - self.normal.dot(leaf.normals * self.normal);
        leaf.weight * (across * across + SPREAD * offset.length_squared()) + TURN * turned
    }
}

/// A group that may be divided.
struct Group {
    leaves: Vec<u32>,
    /// By how much the best division reduces the error, and its parts.
    division: Option<(f64, Vec<u32>, Vec<u32>)>,
}

impl Group {
    fn new(leaves: Vec<u32>, all: &[Moments], size: f64) -> Self {
        let division = divide(&leaves, all, size);
        Self { leaves, division }
    }

    fn gain(&self) -> f64 {
        self.division.as_ref().map_or(f64::NEG_INFINITY, |(gain, ..)| *gain)
    }
}

impl PartialEq for Group {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Group {}

impl PartialOrd for Group {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Group {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain().total_cmp(&other.gain()).then_with(|| other.leaves.cmp(&self.leaves))
    }
}

/// Divides leaves into at most `n` groups. `size` is that of a leaf. No group is empty.
pub(super) fn group(leaves: &[Moments], n: usize, size: f64) -> Vec<LeafGroup> {
    let mut groups = BinaryHeap::from([Group::new((0..leaves.len() as u32).collect(), leaves, size)]);
    while groups.len() < n {
        let Some(mut first) = groups.pop() else { break };
        let Some((_, one, other)) = first.division.take() else {
            groups.push(first);
            break;
        };
        let (one, other) = rayon::join(|| Group::new(one, leaves, size), || Group::new(other, leaves, size));
        groups.extend([one, other]);
    }
    let mut groups: Vec<Vec<u32>> = groups.into_iter().map(|group| group.leaves).collect();
    groups.sort_unstable();
    for _ in 0..ROUNDS {
        groups = reassign(&groups, leaves, size);
    }
    let with_plane = |group: Vec<u32>| {
        let plane = sum(&group, leaves).plane(size).0;
        LeafGroup { leaves: group, centre: plane.centre.as_vec3(), normal: plane.normal.as_vec3() }
    };
    groups.into_iter().map(with_plane).collect()
}

/// Lets each leaf join the group whose plane suits it best.
fn reassign(groups: &[Vec<u32>], leaves: &[Moments], size: f64) -> Vec<Vec<u32>> {
    let planes: Vec<Plane> = groups.iter().map(|group| sum(group, leaves).plane(size).0).collect();
    let best = |leaf: &Moments| {
        let errors = planes.iter().map(|plane| plane.error(leaf, size)).enumerate();
        errors.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
    };
    let chosen: Vec<usize> = leaves.par_iter().map(best).collect();
    let mut new = vec![Vec::new(); groups.len()];
    chosen.into_iter().zip(0..).for_each(|(group, leaf)| new[group].push(leaf));
    new.retain(|group| !group.is_empty());
    new
}

/// The division of a group that reduces its error most, and by how much. `None` for a single leaf.
fn divide(group: &[u32], leaves: &[Moments], size: f64) -> Option<(f64, Vec<u32>, Vec<u32>)> {
    if group.len() < 2 {
        return None;
    }
    let whole = sum(group, leaves);
    let error = whole.plane(size).1;
    let (places, turns) = (axes(whole.scatter()), axes(whole.normals));
    let by_place = |axis: DVec3| move |leaf: &Moments| leaf.centre().dot(axis);
    let by_turn =
        |axis: DVec3| move |leaf: &Moments| axis.dot(leaf.normals * axis) / leaf.weight.max(f64::MIN_POSITIVE);
    let place = [places.x_axis, places.y_axis, places.z_axis].map(|axis| order(group, leaves, by_place(axis)));
    let turn = [turns.x_axis, turns.z_axis].map(|axis| order(group, leaves, by_turn(axis)));
    let mut best: Option<(f64, &Vec<u32>, usize)> = None;
    for sorted in place.iter().chain(&turn) {
        for (cut, parts) in cuts(sorted, leaves, &whole) {
            let gain = error - parts.map(|part| part.plane(size).1).iter().sum::<f64>();
            if best.is_none_or(|(most, ..)| gain > most) {
                best = Some((gain, sorted, cut));
            }
        }
    }
    let (gain, sorted, cut) = best?;
    Some((gain, sorted[..cut].to_vec(), sorted[cut..].to_vec()))
}

/// The places where an ordered group may be divided, with the sums of either part. None is empty.
fn cuts(sorted: &[u32], leaves: &[Moments], whole: &Moments) -> Vec<(usize, [Moments; 2])> {
    let (mut before, mut found) = (Moments::ZERO, Vec::new());
    let mut wanted = CUTS.iter().map(|cut| cut * whole.weight).peekable();
    for (i, leaf) in sorted.iter().enumerate() {
        if i > 0 && wanted.next_if(|&wanted| before.weight >= wanted).is_some() {
            found.push((i, [before, whole.less(&before)]));
        }
        before.add(&leaves[*leaf as usize]);
    }
    if found.is_empty() {
        let cut = sorted.len() / 2;
        let first = sum(&sorted[..cut], leaves);
        found.push((cut, [first, whole.less(&first)]));
    }
    found
}

fn order(group: &[u32], leaves: &[Moments], key: impl Fn(&Moments) -> f64) -> Vec<u32> {
    let mut keyed: Vec<(f64, u32)> = group.iter().map(|&leaf| (key(&leaves[leaf as usize]), leaf)).collect();
    keyed.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    keyed.into_iter().map(|(_, leaf)| leaf).collect()
}

fn sum(group: &[u32], leaves: &[Moments]) -> Moments {
    group.iter().map(|&leaf| leaves[leaf as usize]).sum()
}

/// Orthonormal eigenvectors of a symmetric matrix, by falling eigenvalues.
fn axes(matrix: DMat3) -> DMat3 {
    let largest = matrix.to_cols_array().into_iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x.abs()));
    let axes: Mat3 = principal_axes((matrix * (1.0 / largest)).as_mat3());
    axes.as_dmat3()
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle around a point, of about unit size.
    fn leaf(centre: Vec3, [u, v]: [Vec3; 2]) -> Moments {
        Moments::of_triangle([centre + u * 0.6, centre - u * 0.3 + v * 0.5, centre - u * 0.3 - v * 0.5], 1.0)
    }

    const LEVEL: [Vec3; 2] = [Vec3::X, Vec3::Z];
    const UPRIGHT: [Vec3; 2] = [Vec3::X, Vec3::Y];

    /// `n` by `n` leaves in the plane with this height.
    fn layer(n: usize, height: f32) -> Vec<Moments> {
        let place = |i: usize| Vec3::new((i % n) as f32, height, (i / n) as f32);
        (0..n * n).map(|i| leaf(place(i), LEVEL)).collect()
    }

    fn members(groups: &[LeafGroup]) -> Vec<Vec<u32>> {
        let mut members: Vec<Vec<u32>> = groups.iter().map(|group| group.leaves.clone()).collect();
        members.sort_unstable();
        members
    }

    #[test]
    fn two_layers_are_two_groups_in_their_planes() {
        let leaves = [layer(4, 0.0), layer(4, 5.0)].concat();
        let mut groups = group(&leaves, 2, 1.0);
        groups.sort_unstable_by_key(|group| group.leaves[0]);
        assert_eq!(members(&groups), [(0..16).collect::<Vec<u32>>(), (16..32).collect()]);
        for (group, height) in groups.iter().zip([0.0, 5.0]) {
            assert!(group.centre.distance(Vec3::new(1.5, height, 1.5)) < 1e-5, "{group:?}");
            assert!(group.normal.y.abs() > 0.9999, "{group:?}");
        }
    }

    #[test]
    fn leaves_at_one_place_are_told_apart_by_their_normals() {
        // Blades of two directions, in turns along a line.
        let blade = |i: u32| leaf(Vec3::X * i as f32 * 0.1, if i.is_multiple_of(2) { LEVEL } else { UPRIGHT });
        let leaves: Vec<Moments> = (0..12).map(blade).collect();
        let even_and_odd: [Vec<u32>; 2] = [0, 1].map(|first| (first..12).step_by(2).collect());
        assert_eq!(members(&group(&leaves, 2, 1.0)), even_and_odd);
    }

    #[test]
    fn each_leaf_is_in_one_group_and_no_group_is_empty() {
        let leaves = [layer(3, 0.0), layer(3, 1.0), layer(3, 1.0)].concat();
        for n in [1, 2, 7, 27, 40] {
            let groups = members(&group(&leaves, n, 1.0));
            assert!(groups.len() <= n && groups.iter().all(|group| !group.is_empty()));
            let mut all = groups.concat();
            all.sort_unstable();
            assert_eq!(all, (0..27).collect::<Vec<u32>>(), "{n}");
        }
        assert_eq!(members(&group(&leaves[..1], 9, 1.0)), [[0]]);
    }

    #[test]
    fn the_error_of_a_plane_is_the_turn_and_the_distance() {
        let flat: Moments = layer(3, 0.0).into_iter().sum();
        let (plane, error) = flat.plane(1.0);
        assert!(plane.normal.y.abs() > 0.9999);
        // What is left is the spread: 12 over the centres, and that of each leaf around its own.
        let own = 9.0 * (0.6 * 0.6 + 2.0 * 0.3 * 0.3 + 2.0 * 0.5 * 0.5) / 12.0;
        assert!((error - SPREAD * (12.0 + own)).abs() < 1e-5, "{error}");
        // A leaf two above it, upright: its square, its spread, its turn.
        let error = plane.error(&leaf(Vec3::new(1.0, 2.0, 1.0), UPRIGHT), 1.0);
        assert!((error - (4.0 + SPREAD * 4.0 + TURN)).abs() < 1e-5, "{error}");
    }
}
