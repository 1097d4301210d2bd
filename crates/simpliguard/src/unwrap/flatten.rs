//! Lays charts flat and bisects those that do not lie flat, until each chart is valid.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use glam::DVec3;

use super::chart::{Chart, FlatChart};
use super::half_edge_mesh::HalfEdgeMesh;
use super::lscm::parametrise;
use super::quality::StretchLimit;
use crate::geometry::DisjointSets;

/// Rounds of growing and seeding again.
const ROUNDS: usize = 4;

/// Lays the connected set `faces` flat in as many charts as that takes; a chart of a single face is always valid.
pub(super) fn flatten(mesh: &HalfEdgeMesh, faces: Vec<u32>, limit: StretchLimit) -> Vec<FlatChart> {
    let mut open = vec![faces];
    let mut out = Vec::new();
    while let Some(faces) = open.pop() {
        let chart = Chart::new(mesh, faces);
        match parametrise(mesh, &chart, limit) {
            Some(uv) => out.push(FlatChart { chart, uv }),
            None => open.extend(bisect(mesh, &chart.faces)),
        }
    }
    out
}

/// The faces for which `is_alone(index)` is true, each in a set of its own, and the connected components of the others.
pub(super) fn isolate(mesh: &HalfEdgeMesh, faces: &[u32], is_alone: impl Fn(usize) -> bool) -> Vec<Vec<u32>> {
    let mut sets = DisjointSets::new(faces.len());
    for (i, &f) in faces.iter().enumerate() {
        for (_, n) in mesh.neighbours(f) {
            if let Ok(j) = faces.binary_search(&n)
                && !is_alone(i)
                && !is_alone(j)
            {
                sets.join(i, j);
            }
        }
    }
    sets.members().into_iter().map(|set| set.into_iter().map(|i| faces[i as usize]).collect()).collect()
}

/// Bisects at least two connected faces into two connected, non-empty halves by variational shape approximation
/// (Cohen-Steiner et al. 2004). Both halves grow from seeds over the faces with normals nearest to their axes. Then the
/// mean normals become the axes, and the faces nearest to them the seeds.
fn bisect(mesh: &HalfEdgeMesh, faces: &[u32]) -> [Vec<u32>; 2] {
    let mut seeds = farthest_faces(mesh, faces);
    // The half of each face, 0 or 1.
    let mut side = Vec::new();
    for _ in 0..ROUNDS {
        let axes = if side.is_empty() {
            seeds.map(|s| mesh.normal[faces[s] as usize])
        } else {
            mean_normals(mesh, faces, &side)
        };
        if !side.is_empty() {
            seeds = best_faces(mesh, faces, &side, axes);
        }
        side = grow(mesh, faces, seeds, axes);
    }
    [0u8, 1].map(|wanted| faces.iter().zip(&side).filter(|&(_, &s)| s == wanted).map(|(&f, _)| f).collect())
}

/// Indices of two faces far apart along the surface.
fn farthest_faces(mesh: &HalfEdgeMesh, faces: &[u32]) -> [usize; 2] {
    let last_reached = |start: usize| {
        let mut seen = BTreeSet::from([start]);
        let mut order = vec![start];
        let mut head = 0;
        while head < order.len() {
            for (_, n) in mesh.neighbours(faces[order[head]]) {
                if let Ok(i) = faces.binary_search(&n)
                    && seen.insert(i)
                {
                    order.push(i);
                }
            }
            head += 1;
        }
        order[order.len() - 1]
    };
    let a = last_reached(0);
    [a, last_reached(a)]
}

/// The unit mean normal of each half, weighted by area.
fn mean_normals(mesh: &HalfEdgeMesh, faces: &[u32], side: &[u8]) -> [DVec3; 2] {
    let mut sums = [DVec3::ZERO; 2];
    for (&f, &s) in faces.iter().zip(side) {
        sums[usize::from(s)] += mesh.normal[f as usize] * mesh.area[f as usize];
    }
    sums.map(DVec3::normalize_or_zero)
}

/// The index of the face of each half whose normal is nearest to the half's axis.
fn best_faces(mesh: &HalfEdgeMesh, faces: &[u32], side: &[u8], axes: [DVec3; 2]) -> [usize; 2] {
    [0, 1]
        .map(|s| {
            let fit = |i: usize| mesh.normal[faces[i] as usize].dot(axes[s]);
            (0..faces.len()).filter(|&i| usize::from(side[i]) == s).reduce(|a, b| if fit(b) > fit(a) { b } else { a })
        })
        .map(|seed| seed.unwrap_or(0))
}

/// The half of each face. Both halves grow at once, the face with the least cost first. Every face is reached because
/// the chart is connected.
fn grow(mesh: &HalfEdgeMesh, faces: &[u32], seeds: [usize; 2], axes: [DVec3; 2]) -> Vec<u8> {
    let mut side = vec![u8::MAX; faces.len()];
    let cost = |i: usize, s: usize| {
        let f = faces[i] as usize;
        mesh.area[f] * (mesh.normal[f] - axes[s]).length_squared() + 1e-3 * mesh.area[f]
    };
    let mut queue = BinaryHeap::new();
    for (s, &seed) in seeds.iter().enumerate() {
        queue.push(Reverse((0u64, seed, s as u8)));
    }
    while let Some(Reverse((_, i, s))) = queue.pop() {
        if side[i] != u8::MAX {
            continue;
        }
        side[i] = s;
        for (_, n) in mesh.neighbours(faces[i]) {
            if let Ok(j) = faces.binary_search(&n)
                && side[j] == u8::MAX
            {
                queue.push(Reverse((cost(j, usize::from(s)).to_bits(), j, s)));
            }
        }
    }
    side
}

#[cfg(test)]
mod tests {
    use super::super::tests::{cube, sphere, tetrahedron};
    use super::*;

    #[test]
    fn a_closed_surface_is_split_into_discs_that_cover_it_once() {
        for mesh in [tetrahedron(), cube(), sphere(2)] {
            let mesh = HalfEdgeMesh::new(&mesh, None);
            let all: Vec<u32> = (0..mesh.faces() as u32).collect();
            let charts = flatten(&mesh, all.clone(), StretchLimit(1.3));
            let mut covered: Vec<u32> = charts.iter().flat_map(|c| c.chart.faces.clone()).collect();
            covered.sort_unstable();
            assert_eq!(covered, all);
            assert!(charts.len() > 1 && charts.len() <= 16, "{}", charts.len());
        }
    }

    #[test]
    fn the_parts_around_a_removed_face_stay_whole() {
        let mesh = HalfEdgeMesh::new(&cube(), None);
        // Two sides of the belt: faces 4 and 7 meet at their common edge, 5 and 6 lie at the ends.
        assert_eq!(isolate(&mesh, &[4, 5, 6, 7], |i| i == 1), [vec![4, 6, 7], vec![5]]);
        assert_eq!(isolate(&mesh, &[4, 5, 6, 7], |i| i == 0), [vec![4], vec![5], vec![6, 7]]);
    }
}
