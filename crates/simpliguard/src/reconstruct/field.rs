//! Unsigned distance to the source in a narrow band, by octree descent with triangle lists.
//!
//! Let a node have the half diagonal `r`, and let its centre lie at the distance `d` from the nearest triangle. A
//! triangle can be the nearest one of a point of the node only if its distance to the centre is at most `d + 2 r`. Each
//! node hands the triangles that pass this test down to its children, so no search tree is needed and the lists shrink
//! to a handful. Lengths are in cells, so the work does not depend on the size of the model.

use glam::{IVec3, Vec3, Vec3A, Vec4};
use rayon::prelude::*;

use super::grid::{BRICK, BRICK_SAMPLES, Brick, BrickGrid, corner_offset, local_index};
use super::triangle::{Facet, Points};
use crate::Cancellation;
use crate::data::{Reconstruction, TriMesh, bounds};
use crate::geometry::closest_point;

/// Width of the band beyond the surface level that has bricks: every cell that may change sign lies within.
const BAND: f32 = 2.5;
/// Width of the band beyond the surface level that has distances: both ends of every edge that crosses it.
const SAMPLED: f32 = 1.001;
/// Samples along the side of a task, the node that one thread works on.
const TASK: i32 = 32;
/// Tolerance for rounding, in cells.
const SLACK: f32 = 1e-3;

/// Samples the distance field; no sample is inside yet.
pub(super) fn build(mesh: &TriMesh, params: &Reconstruction, cancellation: &Cancellation) -> BrickGrid {
    let used: Vec<Vec3> = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]).collect();
    let (low, high) = bounds(&used);
    let samples = params.resolution as i32;
    let spacing = params.spacing((high - low).max_element());
    let centre = Vec3A::from((low + high) * 0.5);
    let middle = (samples - 1) as f32 * 0.5;
    let to_cells = |v: u32| (Vec3A::from(mesh.positions[v as usize]) - centre) / spacing + middle;
    let corners: Vec<[Vec3A; 3]> = mesh.triangles.iter().map(|t| t.map(to_cells)).collect();
    let bricks = Descent::new(corners, params.offset).bricks(samples, cancellation);
    let origin = centre - Vec3A::splat(middle * spacing);
    BrickGrid::new(samples / BRICK as i32, spacing, origin, params.offset, bricks)
}

/// The triangles in cells, prepared for the descent through the octree.
struct Descent {
    corners: Vec<[Vec3A; 3]>,
    spheres: Vec<CentroidSphere>,
    /// Surface level in cells.
    offset: f32,
}

/// A sphere around a triangle. It rules out most triangles, at a tenth of the cost of the exact distance.
#[derive(Clone, Copy)]
struct CentroidSphere {
    /// The centroid, a point of the triangle.
    centre: Vec3A,
    radius: f32,
}

impl CentroidSphere {
    fn around(corners: &[Vec3A; 3]) -> Self {
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = corners.iter().map(|p| p.distance_squared(centre)).fold(0.0, f32::max).sqrt();
        Self { centre, radius }
    }
}

/// A node of the octree: `size` cubed samples from `origin` on.
#[derive(Clone, Copy)]
struct Node {
    origin: IVec3,
    size: i32,
}

impl Node {
    fn children(self) -> impl Iterator<Item = Self> {
        let size = self.size / 2;
        (0..8).map(move |child| Self { origin: self.origin + corner_offset(child) * size, size })
    }
}

/// The bricks of a task that are done, and the flag that stops it.
struct Bricks<'a> {
    bricks: Vec<Brick>,
    cancellation: &'a Cancellation,
}

/// The triangle lists of all nodes from a task down to the current node, each behind that of its parent.
struct Lists {
    triangles: Vec<u32>,
    /// Lower bounds on the distances to the centre of the node that listed the triangles.
    distances: Vec<f32>,
    /// Scratch: the triangles of a leaf, prepared. Prepared once for all leaves, those of a scan would take a gigabyte.
    facets: Vec<Facet>,
}

impl Lists {
    fn new(triangles: Vec<u32>) -> Self {
        Self { distances: vec![0.0; triangles.len()], triangles, facets: Vec::new() }
    }

    fn truncate(&mut self, len: usize) {
        self.triangles.truncate(len);
        self.distances.truncate(len);
    }

    /// Drops the triangles from `start` on that are farther than `limit`.
    fn retain_within(&mut self, limit: f32, start: usize) {
        let mut kept = start;
        for i in start..self.triangles.len() {
            if self.distances[i] <= limit {
                self.triangles[kept] = self.triangles[i];
                self.distances[kept] = self.distances[i];
                kept += 1;
            }
        }
        self.truncate(kept);
    }
}

impl Descent {
    fn new(corners: Vec<[Vec3A; 3]>, offset: f32) -> Self {
        let spheres = corners.iter().map(CentroidSphere::around).collect();
        Self { corners, spheres, offset }
    }

    /// The bricks of the band in a grid of `samples` cubed; some are missing if cancelled.
    fn bricks(&self, samples: i32, cancellation: &Cancellation) -> Vec<Brick> {
        let bricks: Vec<Vec<Brick>> = self
            .tasks(samples)
            .into_par_iter()
            .with_max_len(1)
            .take_any_while(|_| !cancellation.is_cancelled())
            .map(|(task, list)| self.bricks_of_task(task, list, cancellation))
            .collect();
        bricks.into_iter().flatten().collect()
    }

    /// The nodes of [`TASK`] samples whose band may hold a triangle, each with those triangles.
    fn tasks(&self, samples: i32) -> Vec<(Node, Vec<u32>)> {
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
        let task = |i: i32| {
            let origin = IVec3::new(i % per_side, i / per_side % per_side, i / per_side / per_side) * TASK;
            Node { origin, size: TASK }
        };
        let filled = lists.into_iter().enumerate().filter(|(_, list)| !list.is_empty());
        filled.map(|(i, list)| (task(i as i32), list)).collect()
    }

    fn bricks_of_task(&self, task: Node, list: Vec<u32>, cancellation: &Cancellation) -> Vec<Brick> {
        let mut lists = Lists::new(list);
        let mut out = Bricks { bricks: Vec::new(), cancellation };
        self.descend(task, 0, &mut lists, &mut out);
        out.bricks
    }

    /// Appends the bricks of a node of at least a brick, whose parent's triangles are `lists[start..]`.
    fn descend(&self, node: Node, start: usize, lists: &mut Lists, out: &mut Bricks<'_>) {
        let end = lists.triangles.len();
        if !out.cancellation.is_cancelled() && self.narrow(node, self.offset + BAND, start, lists) {
            if node.size == BRICK as i32 {
                let mut brick = Brick::new(node.origin >> IVec3::splat(3));
                for child in node.children() {
                    self.fill(child, end, lists, &mut brick.distance);
                }
                out.bricks.push(brick);
            } else {
                for child in node.children() {
                    self.descend(child, end, lists, out);
                }
            }
        }
        lists.truncate(end);
    }

    /// Fills the distances of a node within a brick, whose parent's triangles are `lists[start..]`.
    fn fill(&self, node: Node, start: usize, lists: &mut Lists, distance: &mut [f32; BRICK_SAMPLES]) {
        let end = lists.triangles.len();
        if self.narrow(node, self.offset + SAMPLED, start, lists) {
            if node.size == 2 || end + 2 >= lists.triangles.len() {
                lists.facets.clear();
                lists.facets.extend(lists.triangles[end..].iter().map(|&t| Facet::new(&self.corners[t as usize])));
                evaluate(node, &lists.facets, distance);
            } else {
                for child in node.children() {
                    self.fill(child, end, lists, distance);
                }
            }
        }
        lists.truncate(end);
    }

    /// Appends those of `lists[start..]` that may be nearest to a sample of the node; false if none is within the band.
    fn narrow(&self, node: Node, band: f32, start: usize, lists: &mut Lists) -> bool {
        let reach = (node.size - 1) as f32 * 0.5;
        let centre = node.origin.as_vec3a() + reach;
        let half_diagonal = reach * 1.732_051 + SLACK;
        let end = lists.triangles.len();
        let mut limit = half_diagonal + band;
        for i in start..end {
            let triangle = lists.triangles[i];
            let CentroidSphere { centre: point, radius } = self.spheres[triangle as usize];
            let (squared, farthest) = (point.distance_squared(centre), limit + radius);
            if squared > farthest * farthest {
                continue;
            }
            // Bounds on the distance. The sphere gives them where it is small, else they are the exact distance.
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
        lists.retain_within(limit, end);
        lists.triangles.len() > end
    }
}

/// Distances of the node's samples to the nearest of the triangles, four samples at a time.
fn evaluate(node: Node, facets: &[Facet], distance: &mut [f32; BRICK_SAMPLES]) {
    let Node { origin, size } = node;
    for z in (origin.z..origin.z + size).step_by(2) {
        for y in (origin.y..origin.y + size).step_by(2) {
            for x in (origin.x..origin.x + size).step_by(2) {
                let sample = IVec3::new(x, y, z);
                let at = sample.as_vec3();
                let layers = [Points::square(at), Points::square(at + Vec3::Z)];
                let mut nearest = [Vec4::MAX; 2];
                for facet in facets {
                    for (nearest, points) in nearest.iter_mut().zip(&layers) {
                        *nearest = nearest.min(facet.distances_squared(points));
                    }
                }
                let first = local_index(sample);
                for (layer, nearest) in nearest.iter().enumerate() {
                    for (i, d) in nearest.to_array().into_iter().enumerate() {
                        distance[first + 64 * layer + 8 * (i >> 1) + (i & 1)] = d.sqrt();
                    }
                }
            }
        }
    }
}
