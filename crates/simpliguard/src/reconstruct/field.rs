//! Unsigned distance to the source in a narrow band, by octree descent with triangle lists.
//!
//! A node of half diagonal `r` whose centre is `d` away from its nearest triangle can only have a triangle as the nearest
//! of any of its points if that is within `d + 2 r` of the centre: each node hands the triangles that pass down to its
//! children, so no search tree is needed and the lists shrink to a handful. Lengths are in cells: the work is the same
//! for a model of any size.

use glam::{IVec3, Vec3, Vec3A, Vec4};
use rayon::prelude::*;

use super::triangle::{Facet, Points};
use super::{BRICK, BRICK_SAMPLES, Brick, Grid, NO_BRICK};
use crate::Cancellation;
use crate::data::Reconstruction;
use crate::data::bounds;
use crate::geometry::closest_point;

/// Width of the band beyond the surface level that has bricks: every cell that may change sign lies within.
const BAND: f32 = 2.5;
/// Width of the band beyond the surface level that has distances: both ends of every edge that crosses it.
const SAMPLED: f32 = 1.001;
/// Samples along the side of the nodes that are worked on in parallel.
const TASK: i32 = 32;
/// Slack for rounding, in cells.
const SLACK: f32 = 1e-3;

/// What the descent needs to know everywhere.
struct Descent<'a> {
    corners: &'a [[Vec3A; 3]],
    spheres: &'a [Sphere],
    facets: &'a [Facet],
    offset: f32,
}

/// Around a triangle: most are ruled out by it, at a tenth of the cost of the exact distance.
#[derive(Clone, Copy)]
struct Sphere {
    /// A point of the triangle.
    centre: Vec3A,
    radius: f32,
}

impl Sphere {
    fn around(corners: &[Vec3A; 3]) -> Self {
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = corners.iter().map(|p| p.distance_squared(centre)).fold(0.0, f32::max).sqrt();
        Self { centre, radius }
    }
}

/// Triangle lists of the nodes from the root of a task down to the node at work, one behind the other.
#[derive(Default)]
struct Lists {
    triangles: Vec<u32>,
    distances: Vec<f32>,
}

/// Samples the distance field; inside flags are all unset.
pub(super) fn build(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    params: &Reconstruction,
    cancellation: &Cancellation,
) -> Grid {
    let used: Vec<Vec3> = triangles.iter().flatten().map(|&v| positions[v as usize]).collect();
    let (low, high) = bounds(&used);
    let samples = params.resolution as i32;
    let spacing = params.spacing((high - low).max_element());
    let centre = Vec3A::from((low + high) * 0.5);
    let middle = (samples - 1) as f32 * 0.5;
    let to_cells = |v: u32| (Vec3A::from(positions[v as usize]) - centre) / spacing + middle;
    let corners: Vec<[Vec3A; 3]> = triangles.iter().map(|t| t.map(to_cells)).collect();
    let spheres: Vec<Sphere> = corners.iter().map(Sphere::around).collect();
    let facets: Vec<Facet> = corners.iter().map(Facet::new).collect();
    let descent = Descent { corners: &corners, spheres: &spheres, facets: &facets, offset: params.offset };

    let bricks: Vec<Vec<Brick>> = descent
        .tasks(samples)
        .into_par_iter()
        .with_max_len(1)
        .take_any_while(|_| !cancellation.is_cancelled())
        .map(|(origin, list)| descent.bricks_of_task(origin, list))
        .collect();

    let side = samples / BRICK as i32;
    let mut grid = Grid {
        side,
        spacing,
        origin: centre - Vec3A::splat(middle * spacing),
        offset: params.offset,
        table: vec![NO_BRICK; (side * side * side) as usize],
        bricks: bricks.into_iter().flatten().collect(),
        empty_outside: vec![false; (side * side * side) as usize],
    };
    for i in 0..grid.bricks.len() {
        if let Some(slot) = grid.slot(grid.bricks[i].coordinate) {
            grid.table[slot] = i as u32;
        }
    }
    grid
}

impl Descent<'_> {
    /// Nodes of [`TASK`] samples that a triangle's box touches, with those triangles.
    fn tasks(&self, samples: i32) -> Vec<(IVec3, Vec<u32>)> {
        let per_side = samples.div_euclid(TASK) + i32::from(samples % TASK != 0);
        let mut lists = vec![Vec::new(); (per_side * per_side * per_side) as usize];
        for (t, corners) in self.corners.iter().enumerate() {
            let band = self.offset + BAND;
            let low = corners[0].min(corners[1]).min(corners[2]) - band;
            let high = corners[0].max(corners[1]).max(corners[2]) + band;
            let node =
                |p: Vec3A| (p.floor().as_ivec3() >> IVec3::splat(5)).clamp(IVec3::ZERO, IVec3::splat(per_side - 1));
            let (a, b) = (node(low), node(high));
            for z in a.z..=b.z {
                for y in a.y..=b.y {
                    for x in a.x..=b.x {
                        lists[(x + per_side * (y + per_side * z)) as usize].push(t as u32);
                    }
                }
            }
        }
        let coordinate = |i: i32| IVec3::new(i % per_side, i / per_side % per_side, i / per_side / per_side) * TASK;
        let filled = lists.into_iter().enumerate().filter(|(_, list)| !list.is_empty());
        filled.map(|(i, list)| (coordinate(i as i32), list)).collect()
    }

    fn bricks_of_task(&self, origin: IVec3, list: Vec<u32>) -> Vec<Brick> {
        let mut lists = Lists { distances: vec![0.0; list.len()], triangles: list };
        let mut bricks = Vec::new();
        self.simplify_to_budgets(origin, TASK, 0, &mut lists, &mut bricks);
        bricks
    }

    /// Handles a node of at least a brick, whose candidates are `lists[start..]`.
    fn simplify_to_budgets(&self, origin: IVec3, size: i32, start: usize, lists: &mut Lists, bricks: &mut Vec<Brick>) {
        let end = lists.triangles.len();
        if self.narrow(origin, size, self.offset + BAND, start, lists) {
            let half = size / 2;
            if size == BRICK as i32 {
                let mut distance = Box::new([f32::MAX; BRICK_SAMPLES]);
                for child in 0..8 {
                    self.fill(octant(child) * half, origin, half, end, lists, &mut distance);
                }
                bricks.push(Brick { coordinate: origin >> IVec3::splat(3), distance, inside: [0; BRICK] });
            } else {
                for child in 0..8 {
                    self.simplify_to_budgets(origin + octant(child) * half, half, end, lists, bricks);
                }
            }
        }
        lists.truncate(end);
    }

    /// Fills the part of a brick at `local`, `size` samples wide, from the candidates `lists[start..]`.
    fn fill(
        &self,
        local: IVec3,
        brick: IVec3,
        size: i32,
        start: usize,
        lists: &mut Lists,
        distance: &mut [f32; BRICK_SAMPLES],
    ) {
        let end = lists.triangles.len();
        if self.narrow(brick + local, size, self.offset + SAMPLED, start, lists) {
            if size == 2 || end + 2 >= lists.triangles.len() {
                self.evaluate(local, brick, size, &lists.triangles[end..], distance);
            } else {
                for child in 0..8 {
                    self.fill(local + octant(child) * (size / 2), brick, size / 2, end, lists, distance);
                }
            }
        }
        lists.truncate(end);
    }

    /// Appends those of `lists[start..]` that may be nearest to a sample of the node; false if none is within the band.
    fn narrow(&self, origin: IVec3, size: i32, band: f32, start: usize, lists: &mut Lists) -> bool {
        let reach = (size - 1) as f32 * 0.5;
        let centre = origin.as_vec3a() + reach;
        let half_diagonal = reach * 1.732_051 + SLACK;
        let end = lists.triangles.len();
        let mut limit = half_diagonal + band;
        for i in start..end {
            let triangle = lists.triangles[i];
            let Sphere { centre: point, radius } = self.spheres[triangle as usize];
            let (squared, farthest) = (point.distance_squared(centre), limit + radius);
            if squared > farthest * farthest {
                continue;
            }
            // Bounds on the distance, equal where the sphere says too little.
            let (low, high) = if 2.0 * radius < half_diagonal {
                let d = squared.sqrt();
                (d - radius, d)
            } else {
                let d = closest_point(centre, &self.corners[triangle as usize]).distance(centre);
                (d, d)
            };
            if low <= limit {
                limit = limit.min(high + 2.0 * half_diagonal);
                lists.triangles.push(triangle);
                lists.distances.push(low);
            }
        }
        let mut kept = end;
        for i in end..lists.triangles.len() {
            if lists.distances[i] <= limit {
                lists.triangles[kept] = lists.triangles[i];
                lists.distances[kept] = lists.distances[i];
                kept += 1;
            }
        }
        lists.truncate(kept);
        kept > end
    }

    /// Distances of `size` cubed samples to the nearest of the listed triangles, four samples at a time.
    fn evaluate(&self, local: IVec3, brick: IVec3, size: i32, list: &[u32], distance: &mut [f32; BRICK_SAMPLES]) {
        for z in (local.z..local.z + size).step_by(2) {
            for y in (local.y..local.y + size).step_by(2) {
                for x in (local.x..local.x + size).step_by(2) {
                    let at = (brick + IVec3::new(x, y, z)).as_vec3();
                    let layers = [Points::square(at), Points::square(at + Vec3::Z)];
                    let mut nearest = [Vec4::MAX; 2];
                    for &t in list {
                        let facet = &self.facets[t as usize];
                        for (nearest, points) in nearest.iter_mut().zip(&layers) {
                            *nearest = nearest.min(facet.distances_squared(points));
                        }
                    }
                    let first = (x + 8 * y + 64 * z) as usize;
                    for (layer, nearest) in nearest.iter().enumerate() {
                        for (i, d) in nearest.to_array().into_iter().enumerate() {
                            distance[first + 64 * layer + 8 * (i >> 1) + (i & 1)] = d.sqrt();
                        }
                    }
                }
            }
        }
    }
}

impl Lists {
    fn truncate(&mut self, len: usize) {
        self.triangles.truncate(len);
        self.distances.truncate(len);
    }
}

fn octant(child: i32) -> IVec3 {
    IVec3::new(child & 1, child >> 1 & 1, child >> 2)
}
