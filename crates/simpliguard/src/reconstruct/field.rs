//! Unsigned distance to the source in a narrow band, by octree descent with triangle lists.
//!
//! A node of half diagonal `r` whose centre is `d` away from its nearest triangle can only have a triangle as the nearest
//! of any of its points if that is within `d + 2 r` of the centre: each node hands the triangles that pass down to its
//! children, so no search tree is needed and the lists shrink to a handful.

use glam::{IVec3, Vec3, Vec3A};
use rayon::prelude::*;

use super::{BRICK, BRICK_SAMPLES, Brick, Grid, NO_BRICK, Params};
use crate::bvh::closest_point;
use crate::mesh::bounds;

/// Empty samples around the source on every side.
const MARGIN: f32 = 6.0;
/// Width of the band beyond the surface level, in cells: every cell that may change sign lies within.
const BAND: f32 = 2.5;
/// Samples along the side of the nodes that are worked on in parallel.
const TASK: i32 = 32;

/// What the descent needs to know everywhere.
struct Descent<'a> {
    corners: &'a [[Vec3A; 3]],
    spheres: &'a [Sphere],
    spacing: f32,
    origin: Vec3A,
    band: f32,
}

/// Around a triangle: most are ruled out by it, at a tenth of the cost of the exact distance.
#[derive(Clone, Copy)]
struct Sphere {
    centre: Vec3A,
    radius: f32,
}

impl Sphere {
    fn around(corners: &[Vec3A; 3]) -> Self {
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = corners.iter().map(|p| p.distance_squared(centre)).fold(0.0, f32::max).sqrt();
        Self { centre, radius }
    }

    /// No point of the triangle is closer to `p`, but for rounding.
    fn least_distance(&self, p: Vec3A) -> f32 {
        p.distance(self.centre) - self.radius
    }
}

/// Triangle lists of the nodes from the root of a task down to the node at work, one behind the other.
#[derive(Default)]
struct Lists {
    triangles: Vec<u32>,
    distances: Vec<f32>,
}

/// Samples the distance field; inside flags are all unset.
pub(super) fn build(positions: &[Vec3], triangles: &[[u32; 3]], params: &Params) -> Grid {
    let corners: Vec<[Vec3A; 3]> = triangles.iter().map(|t| t.map(|v| Vec3A::from(positions[v as usize]))).collect();
    let used: Vec<Vec3> = triangles.iter().flatten().map(|&v| positions[v as usize]).collect();
    let (low, high) = bounds(&used);
    let samples = params.resolution as i32;
    let spacing = spacing((high - low).max_element(), params.resolution);
    let origin = Vec3A::from((low + high) * 0.5) - Vec3A::splat((samples - 1) as f32 * 0.5 * spacing);
    let offset = params.offset * spacing;
    let spheres: Vec<Sphere> = corners.iter().map(Sphere::around).collect();
    let descent = Descent { corners: &corners, spheres: &spheres, spacing, origin, band: offset + BAND * spacing };

    let bricks: Vec<Brick> = descent
        .tasks(samples)
        .into_par_iter()
        .with_max_len(1)
        .map(|(origin, list)| descent.bricks_of_task(origin, list))
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect();

    let side = samples / BRICK as i32;
    let mut grid = Grid {
        side,
        spacing,
        origin,
        offset,
        table: vec![NO_BRICK; (side * side * side) as usize],
        bricks: Vec::new(),
        empty_outside: vec![false; (side * side * side) as usize],
    };
    for (i, brick) in bricks.iter().enumerate() {
        if let Some(slot) = grid.slot(brick.coordinate) {
            grid.table[slot] = i as u32;
        }
    }
    grid.bricks = bricks;
    grid
}

/// Distance between samples for a source whose longest side is `extent`.
pub(super) fn spacing(extent: f32, resolution: u32) -> f32 {
    extent.max(f32::MIN_POSITIVE * 1e6) / (resolution as f32 - 2.0 * MARGIN)
}

/// Least resolution with that spacing or a smaller one.
pub(super) fn resolution(extent: f32, spacing: f32) -> u32 {
    (extent / spacing + 2.0 * MARGIN).ceil() as u32
}

impl Descent<'_> {
    /// Nodes of [`TASK`] samples that a triangle's box touches, with those triangles.
    fn tasks(&self, samples: i32) -> Vec<(IVec3, Vec<u32>)> {
        let per_side = samples.div_euclid(TASK) + i32::from(samples % TASK != 0);
        let mut lists = vec![Vec::new(); (per_side * per_side * per_side) as usize];
        for (t, corners) in self.corners.iter().enumerate() {
            let low = corners[0].min(corners[1]).min(corners[2]) - self.band;
            let high = corners[0].max(corners[1]).max(corners[2]) + self.band;
            let node = |p: Vec3A| {
                let s = ((p - self.origin) / self.spacing).floor().as_ivec3();
                (s >> IVec3::splat(5)).clamp(IVec3::ZERO, IVec3::splat(per_side - 1))
            };
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
        self.descend(origin, TASK, 0, &mut lists, &mut bricks);
        bricks
    }

    /// Handles a node of at least a brick, whose candidates are `lists[start..]`.
    fn descend(&self, origin: IVec3, size: i32, start: usize, lists: &mut Lists, bricks: &mut Vec<Brick>) {
        let end = lists.triangles.len();
        if self.narrow(origin, size, start, lists) {
            let half = size / 2;
            if size == BRICK as i32 {
                let mut distance = Box::new([f32::MAX; BRICK_SAMPLES]);
                for child in 0..8 {
                    self.fill(octant(child) * half, origin, half, end, lists, &mut distance);
                }
                bricks.push(Brick { coordinate: origin >> IVec3::splat(3), distance, inside: [0; BRICK] });
            } else {
                for child in 0..8 {
                    self.descend(origin + octant(child) * half, half, end, lists, bricks);
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
        if self.narrow(brick + local, size, start, lists) {
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
    fn narrow(&self, origin: IVec3, size: i32, start: usize, lists: &mut Lists) -> bool {
        let reach = (size - 1) as f32 * 0.5;
        let centre = self.origin + (origin.as_vec3a() + Vec3A::splat(reach)) * self.spacing;
        let half_diagonal = reach * self.spacing * 1.732_051;
        let end = lists.triangles.len();
        let slack = self.spacing * 1e-4;
        let (far, mut limit) = (half_diagonal + self.band, f32::MAX);
        for i in start..end {
            let triangle = lists.triangles[i];
            if self.spheres[triangle as usize].least_distance(centre) > far.min(limit) + slack {
                continue;
            }
            let d = closest_point(centre, &self.corners[triangle as usize]).distance(centre);
            if d <= far {
                limit = limit.min(d + 2.0 * half_diagonal + slack);
                lists.triangles.push(triangle);
                lists.distances.push(d);
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

    fn evaluate(&self, local: IVec3, brick: IVec3, size: i32, list: &[u32], distance: &mut [f32; BRICK_SAMPLES]) {
        for z in local.z..local.z + size {
            for y in local.y..local.y + size {
                for x in local.x..local.x + size {
                    let p = self.origin + (brick + IVec3::new(x, y, z)).as_vec3a() * self.spacing;
                    distance[(x + 8 * y + 64 * z) as usize] = self.distance(p, list);
                }
            }
        }
    }

    /// Distance from `p` to the nearest of the listed triangles.
    fn distance(&self, p: Vec3A, list: &[u32]) -> f32 {
        let mut nearest = f32::MAX;
        for &t in list {
            if self.spheres[t as usize].least_distance(p) <= nearest + self.spacing * 1e-4 {
                nearest = nearest.min(closest_point(p, &self.corners[t as usize]).distance(p));
            }
        }
        nearest
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
