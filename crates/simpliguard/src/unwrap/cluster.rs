//! Initial charts: faces merged bottom-up by the deviation of their normals.
//!
//! Hierarchical face clustering (Garland et al. 2001) under the `L^{2,1}` metric of Cohen-Steiner et al. 2004: a region
//! of area `A` whose area vectors sum to `S` deviates from its best plane direction by `1 - |S| / A`. The pair with the
//! least cost is merged first, and compact unions cost less than ragged ones. A union must be a disc whose normals lie
//! in a cone.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use glam::DVec3;

use super::half_edge_mesh::HalfEdgeMesh;

/// Largest mean deviation `1 - |S| / A` of a region: a cap of 55 degrees has 0.21, half a cylinder 0.36.
const MOST_DEVIATION: f64 = 0.25;

/// Cosine of the largest angle between a face and the mean normal of its region.
const CONE: f64 = 0.17;

/// Weight of the raggedness beside the deviation in the cost of a union; it decides where the surface is flat.
const SHAPE_WEIGHT: f64 = 0.2;

/// Largest raggedness of a region above the area [`LARGE`]: ragged charts leave holes in the atlas. The raggedness is
/// the squared perimeter over `4 pi` areas: 1 for a disc, 2 for a strip of four squares.
const MOST_RAGGED: f64 = 4.0;

/// Area, as a fraction of the surface, above which the raggedness of a region is bounded.
const LARGE: f64 = 0.01;

/// Area, as a fraction of the surface, above which a region must be [`FLAT`]: a few large round charts pack badly.
const MOST_AREA: f64 = 0.06;

/// Largest mean deviation of a region that counts as flat.
const FLAT: f64 = 0.01;

/// A set of faces that is merged with its neighbours.
struct Region {
    faces: Vec<u32>,
    area: f64,
    /// Sum of area vectors.
    direction: DVec3,
    perimeter: f64,
    /// Area times density.
    texels: f64,
    /// Half-edges of this region towards each neighbour.
    neighbours: BTreeMap<u32, Vec<u32>>,
    /// Number of the region's versions, one more with each merge; 0 for a region that was merged into another.
    version: u32,
}

/// A pair of regions in the queue: cost as ordered bits, both regions, both versions.
type Pair = Reverse<(u64, u32, u32, u32, u32)>;

/// Partitions all faces into discs of similar normals; each list in rising order.
pub(super) fn cluster(mesh: &HalfEdgeMesh) -> Vec<Vec<u32>> {
    let mut regions: Vec<Region> = (0..mesh.faces() as u32).map(|f| Region::of_face(mesh, f)).collect();
    let mut queue = BinaryHeap::new();
    for a in 0..regions.len() as u32 {
        push_neighbours(mesh, &regions, a, |b| b > a, &mut queue);
    }
    while let Some(Reverse((_, a, b, version_a, version_b))) = queue.pop() {
        let (ra, rb) = (&regions[a as usize], &regions[b as usize]);
        if ra.version != version_a || rb.version != version_b {
            continue;
        }
        if !in_cone(mesh, ra, rb) || !shares_one_path(mesh, ra, b) {
            continue;
        }
        merge(mesh, &mut regions, a, b);
        push_neighbours(mesh, &regions, a, |_| true, &mut queue);
    }
    regions
        .into_iter()
        .filter(|r| r.version > 0)
        .map(|mut r| {
            r.faces.sort_unstable();
            r.faces
        })
        .collect()
}

impl Region {
    fn of_face(mesh: &HalfEdgeMesh, f: u32) -> Self {
        let (i, mut neighbours) = (f as usize, BTreeMap::<u32, Vec<u32>>::new());
        for (h, other) in mesh.neighbours(f) {
            neighbours.entry(other).or_default().push(h);
        }
        Self {
            faces: vec![f],
            area: mesh.area[i],
            direction: mesh.normal[i] * mesh.area[i],
            perimeter: mesh.length[3 * i..3 * i + 3].iter().sum(),
            texels: mesh.area[i] * mesh.density[i],
            neighbours,
            version: 1,
        }
    }
}

/// Queues the pairs of region `a` with those of its neighbours that are `wanted`.
fn push_neighbours(
    mesh: &HalfEdgeMesh,
    regions: &[Region],
    a: u32,
    wanted: impl Fn(u32) -> bool,
    queue: &mut BinaryHeap<Pair>,
) {
    let ra = &regions[a as usize];
    for (&b, shared) in &ra.neighbours {
        let rb = &regions[b as usize];
        if wanted(b)
            && let Some(cost) = merge_cost(mesh, ra, rb, shared)
        {
            let (low, high) = (a.min(b), a.max(b));
            let versions = [regions[low as usize].version, regions[high as usize].version];
            queue.push(Reverse((cost.to_bits(), low, high, versions[0], versions[1])));
        }
    }
}

/// The cost of a union, above zero; `None` if the union bends too much or is too ragged or too large.
fn merge_cost(mesh: &HalfEdgeMesh, a: &Region, b: &Region, shared: &[u32]) -> Option<f64> {
    let area = a.area + b.area;
    let deviation = (1.0 - (a.direction + b.direction).length() / area).max(0.0);
    if deviation > MOST_DEVIATION {
        return None;
    }
    let seam: f64 = shared.iter().map(|&h| mesh.length[h as usize]).sum();
    let perimeter = (a.perimeter + b.perimeter - 2.0 * seam).max(0.0);
    let raggedness = perimeter * perimeter / (4.0 * std::f64::consts::PI * area);
    if area > LARGE && raggedness > MOST_RAGGED || area > MOST_AREA && deviation > FLAT {
        return None;
    }
    let density = (a.texels / a.area).max(b.texels / b.area) / (a.texels / a.area).min(b.texels / b.area);
    Some((deviation + SHAPE_WEIGHT) * raggedness.max(1.0) * density)
}

/// True if the normals of both regions lie in a cone around their mean.
fn in_cone(mesh: &HalfEdgeMesh, a: &Region, b: &Region) -> bool {
    let axis = (a.direction + b.direction).normalize_or_zero();
    let inside = |&f: &u32| {
        let normal = mesh.normal[f as usize];
        normal == DVec3::ZERO || normal.dot(axis) >= CONE
    };
    a.faces.iter().chain(&b.faces).all(inside)
}

/// True if region `b` meets `a` along one open path: only then is the union of two discs a disc.
fn shares_one_path(mesh: &HalfEdgeMesh, a: &Region, b: u32) -> bool {
    let Some(shared) = a.neighbours.get(&b) else { return false };
    let mut ends: Vec<[u64; 3]> = shared
        .iter()
        .flat_map(|&h| {
            let (f, k) = (h as usize / 3, h as usize % 3);
            [mesh.corners[f][k], mesh.corners[f][(k + 1) % 3]]
        })
        .map(|p| p.to_array().map(f64::to_bits))
        .collect();
    ends.sort_unstable();
    ends.dedup();
    ends.len() == shared.len() + 1
}

/// Moves region `b` into `a`.
fn merge(mesh: &HalfEdgeMesh, regions: &mut [Region], a: u32, b: u32) {
    let taken = &mut regions[b as usize];
    taken.version = 0;
    let (faces, neighbours) = (std::mem::take(&mut taken.faces), std::mem::take(&mut taken.neighbours));
    let (area, direction, perimeter, texels) = (taken.area, taken.direction, taken.perimeter, taken.texels);
    for (&c, towards) in &neighbours {
        let other = &mut regions[c as usize];
        if let Some(mut moved) = other.neighbours.remove(&b)
            && c != a
        {
            other.neighbours.entry(a).or_default().append(&mut moved);
            regions[a as usize].neighbours.entry(c).or_default().extend_from_slice(towards);
        }
    }
    let seam: f64 = neighbours.get(&a).into_iter().flatten().map(|&h| mesh.length[h as usize]).sum();
    let kept = &mut regions[a as usize];
    kept.faces.extend(faces);
    kept.area += area;
    kept.direction += direction;
    kept.perimeter = (kept.perimeter + perimeter - 2.0 * seam).max(0.0);
    kept.texels += texels;
    kept.version += 1;
}

#[cfg(test)]
mod tests {
    use super::super::tests::{cube, cylinder};
    use super::*;

    #[test]
    fn a_cube_falls_into_its_sides_or_fewer() {
        let charts = cluster(&HalfEdgeMesh::new(&cube(), None));
        assert!(charts.len() <= 6, "{}", charts.len());
        assert_eq!(charts.iter().flatten().count(), 12);
    }

    #[test]
    fn a_cylinder_falls_into_caps_and_strips() {
        let charts = cluster(&HalfEdgeMesh::new(&cylinder(24), None));
        assert!((4..=16).contains(&charts.len()), "{}", charts.len());
    }
}
