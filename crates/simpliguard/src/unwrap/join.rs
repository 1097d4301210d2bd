//! Joins neighbouring charts whose union still lies flat.
//!
//! Clustering by normals is cautious: it keeps charts apart that could be unrolled as one. Here the union of each pair
//! is laid flat, first the pairs that lose the largest fraction of their boundary, and kept if it is a valid flat
//! chart. Small pairs that meet along their whole boundary are joined along a piece of it. Each round tries a set of
//! disjoint pairs, so the result does not depend on the number of threads.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::chart::{Chart, FlatChart};
use super::half_edge_mesh::{HalfEdgeMesh, NO_NEIGHBOUR};
use super::hull::smallest_box;
use super::lscm::parametrise;
use super::quality::StretchLimit;
use super::seam;
use crate::Cancellation;

/// Least fraction of the shorter of both boundaries that a pair must share.
const LEAST_SHARED: f64 = 0.15;

/// Most faces of a union; larger ones cost more time than the texels that they save are worth.
const MOST_FACES: usize = 1500;

/// Largest ratio of mean texel density within a pair.
const MOST_DENSITY_RATIO: f64 = 1.5;

/// Most area that the bounding box of a union leaves empty, beyond the empty area of the boxes of its charts: a
/// fraction of the union's area plus a fraction of the whole surface. Ragged unions cost more texels in packing than
/// their seam saves.
const MOST_WASTE: [f64; 2] = [0.05, 0.004];

/// Area, as a fraction of the surface, above which a union may not waste more than its charts.
const LARGE: f64 = 0.05;

/// Fraction of its bounding box above which a union always packs well.
const LEAST_BOX_FILL: f64 = 0.75;

/// Area, as a fraction of the surface, up to which a union is small: there the gutters of two charts take more texels
/// than the stretch of one.
const SMALL: f64 = 0.01;

/// Stretch that a small union may have.
const SMALL_STRETCH: f64 = 1.2;

/// Joins pairs of charts until none is left whose union is valid.
pub(super) fn join(
    mesh: &HalfEdgeMesh,
    charts: Vec<FlatChart>,
    limit: StretchLimit,
    cancellation: &Cancellation,
) -> Vec<FlatChart> {
    let mut charts: Vec<Option<FlatChart>> = charts.into_iter().map(Some).collect();
    let mut refused = BTreeSet::new();
    while !cancellation.is_cancelled() {
        let pairs = disjoint_pairs(mesh, &charts, &refused);
        if pairs.is_empty() {
            break;
        }
        let unions: Vec<Option<FlatChart>> =
            pairs.par_iter().map(|&(a, b)| union(mesh, charts[a].as_ref()?, charts[b].as_ref()?, limit)).collect();
        for ((a, b), union) in pairs.into_iter().zip(unions) {
            match union {
                Some(_) => {
                    charts[a] = None;
                    charts[b] = None;
                    charts.push(union);
                }
                None => {
                    refused.insert((a, b));
                }
            }
        }
    }
    charts.into_iter().flatten().collect()
}

/// The union of two charts, laid flat; `None` if it is not valid or does not pack well.
fn union(mesh: &HalfEdgeMesh, a: &FlatChart, b: &FlatChart, limit: StretchLimit) -> Option<FlatChart> {
    let mut faces = [&a.chart.faces[..], &b.chart.faces[..]].concat();
    faces.sort_unstable();
    let area_of_both: f64 = faces.iter().map(|&f| mesh.area[f as usize]).sum();
    let limit = if area_of_both <= SMALL { StretchLimit(limit.0.max(SMALL_STRETCH)) } else { limit };
    let mut cuts = [&a.chart.cuts[..], &b.chart.cuts[..]].concat();
    cuts.sort_unstable();
    let mut chart = Chart::with_cuts(mesh, faces, cuts);
    if chart.boundary.is_none() && area_of_both <= LARGE {
        chart.cuts.extend(seam::cuts(mesh, &a.chart, &b.chart)?);
        chart.cuts.sort_unstable();
        chart = Chart::with_cuts(mesh, chart.faces, chart.cuts);
    }
    let uv = parametrise(mesh, &chart, limit)?;
    let union = FlatChart { chart, uv };
    let (area, box_area) = (area(mesh, &union), smallest_box(&union.uv).area);
    let allowed = if area > LARGE { 0.0 } else { MOST_WASTE[0] * area + MOST_WASTE[1] };
    let packs_well = area >= LEAST_BOX_FILL * box_area || box_area - area <= waste(mesh, a) + waste(mesh, b) + allowed;
    packs_well.then_some(union)
}

fn area(mesh: &HalfEdgeMesh, flat: &FlatChart) -> f64 {
    flat.chart.faces.iter().map(|&f| mesh.area[f as usize]).sum()
}

/// The area of the smallest bounding box that the chart leaves empty.
fn waste(mesh: &HalfEdgeMesh, flat: &FlatChart) -> f64 {
    smallest_box(&flat.uv).area - area(mesh, flat)
}

/// Pairs of neighbours that were not refused, those that share the largest fraction first, each chart at most once.
fn disjoint_pairs(
    mesh: &HalfEdgeMesh,
    charts: &[Option<FlatChart>],
    refused: &BTreeSet<(usize, usize)>,
) -> Vec<(usize, usize)> {
    let borders = Borders::of(mesh, charts);
    let mut scored: Vec<(u64, usize, usize)> = borders
        .shared
        .iter()
        .filter(|&(pair, _)| !refused.contains(pair))
        .filter_map(|(&(a, b), &shared)| {
            let share = shared / borders.perimeter[a].min(borders.perimeter[b]).max(f64::MIN_POSITIVE);
            let faces = [a, b].map(|c| charts[c].as_ref().map_or(0, |c| c.chart.faces.len()));
            let densities = [a, b].map(|c| borders.texels[c] / borders.area[c]);
            let ratio = (densities[0] / densities[1]).max(densities[1] / densities[0]);
            (share >= LEAST_SHARED && faces[0] + faces[1] <= MOST_FACES && ratio <= MOST_DENSITY_RATIO).then_some((
                share.to_bits(),
                a,
                b,
            ))
        })
        .collect();
    scored.sort_unstable_by(|x, y| y.0.cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut taken = vec![false; charts.len()];
    scored.retain(|&(_, a, b)| {
        let free = !taken[a] && !taken[b];
        if free {
            taken[a] = true;
            taken[b] = true;
        }
        free
    });
    scored.into_iter().map(|(_, a, b)| (a, b)).collect()
}

/// Lengths and areas of the charts.
struct Borders {
    /// Length of the common boundary of each pair of neighbours, the lower index first.
    shared: BTreeMap<(usize, usize), f64>,
    perimeter: Vec<f64>,
    area: Vec<f64>,
    /// Area times density.
    texels: Vec<f64>,
}

impl Borders {
    fn of(mesh: &HalfEdgeMesh, charts: &[Option<FlatChart>]) -> Self {
        let mut owner = vec![usize::MAX; mesh.faces()];
        for (c, chart) in charts.iter().enumerate() {
            for &f in chart.iter().flat_map(|c| &c.chart.faces) {
                owner[f as usize] = c;
            }
        }
        let n = charts.len();
        let mut out =
            Self { shared: BTreeMap::new(), perimeter: vec![0.0; n], area: vec![0.0; n], texels: vec![0.0; n] };
        for f in 0..mesh.faces() {
            let a = owner[f];
            if a == usize::MAX {
                continue;
            }
            out.area[a] += mesh.area[f];
            out.texels[a] += mesh.area[f] * mesh.density[f];
            for h in 3 * f..3 * f + 3 {
                let other = mesh.opposite[h];
                let b = if other == NO_NEIGHBOUR { usize::MAX } else { owner[other as usize / 3] };
                if a == b {
                    continue;
                }
                out.perimeter[a] += mesh.length[h];
                if b != usize::MAX && a < b {
                    *out.shared.entry((a, b)).or_default() += mesh.length[h];
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::flatten::flatten;
    use super::super::tests::cylinder;
    use super::*;

    #[test]
    fn strips_of_a_cylinder_join_until_they_would_close_up() {
        let mesh = HalfEdgeMesh::new(&cylinder(24), None);
        let limit = StretchLimit(1.1);
        let strips: Vec<FlatChart> =
            (0..48).step_by(6).flat_map(|f| flatten(&mesh, (f..f + 6).collect(), limit)).collect();
        let joined = join(&mesh, strips, limit, &Cancellation::default());
        assert_eq!(joined.len(), 2);
    }
}
