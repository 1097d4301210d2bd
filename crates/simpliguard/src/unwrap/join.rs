//! Joins neighbouring charts whose union still lies flat.
//!
//! Clustering by normals is cautious: it keeps apart what could be unrolled. Here pairs are tried for real, those that
//! lose most of their boundary first, and kept when the union is a valid flat chart. Small pairs that meet all around are joined
//! along a piece of their common border. Each round tries a set of disjoint
//! pairs, so the outcome does not depend on threads.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::chart::{Chart, FlatChart};
use super::hull::smallest_box;
use super::lscm::parametrise;
use super::quality::Limits;
use super::seam;
use super::surface::{NONE, Surface};
use crate::Cancellation;

/// Least part of the smaller chart's boundary that a pair must share.
const LEAST_SHARED: f64 = 0.15;

/// Faces of a union; larger ones cost more time to try than they save texels.
const MOST_FACES: usize = 1500;

/// Largest ratio of mean texel density within a pair.
const MOST_DENSITY_RATIO: f64 = 1.5;

/// Empty part of a union's bounding box beyond that of its charts, as a fraction of its own area and of the whole
/// surface: ragged unions cost more in packing than their seam saves.
const MOST_WASTE: [f64; 2] = [0.05, 0.004];

/// Part of the surface above which a union may not waste more than its charts.
const LARGE: f64 = 0.05;

/// Part of its bounding box that a union may always fill.
const LEAST_BOX_FILL: f64 = 0.75;

/// Part of the surface up to which a union is small: there the gutters of two charts take more texels than its stretch.
const SMALL: f64 = 0.01;

/// Stretch that a small union may have.
const SMALL_STRETCH: f64 = 1.2;

/// Joins pairs until none is left that fits.
pub(super) fn join(
    surface: &Surface,
    charts: Vec<FlatChart>,
    limits: &Limits,
    cancellation: &Cancellation,
) -> Vec<FlatChart> {
    let mut charts: Vec<Option<FlatChart>> = charts.into_iter().map(Some).collect();
    let mut refused = BTreeSet::new();
    while !cancellation.is_cancelled() {
        let pairs = disjoint_pairs(surface, &charts, &refused);
        if pairs.is_empty() {
            break;
        }
        let unions: Vec<Option<FlatChart>> =
            pairs.par_iter().map(|&(a, b)| union(surface, charts[a].as_ref()?, charts[b].as_ref()?, limits)).collect();
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

fn union(surface: &Surface, a: &FlatChart, b: &FlatChart, limits: &Limits) -> Option<FlatChart> {
    let mut faces = [&a.chart.faces[..], &b.chart.faces[..]].concat();
    faces.sort_unstable();
    let area_of_both: f64 = faces.iter().map(|&f| surface.area[f as usize]).sum();
    let stretch = if area_of_both <= SMALL { limits.stretch.max(SMALL_STRETCH) } else { limits.stretch };
    let mut cuts = [&a.chart.cuts[..], &b.chart.cuts[..]].concat();
    cuts.sort_unstable();
    let mut chart = Chart::with_cuts(surface, faces, cuts);
    if chart.boundary.is_none() && area_of_both <= LARGE {
        chart.cuts.extend(seam::cuts(surface, &a.chart, &b.chart)?);
        chart.cuts.sort_unstable();
        chart = Chart::with_cuts(surface, chart.faces, chart.cuts);
    }
    let uv = parametrise(surface, &chart, &Limits { stretch })?;
    let union = FlatChart { chart, uv };
    let (area, box_area) = (area(surface, &union), smallest_box(&union.uv).area);
    let allowed = if area > LARGE { 0.0 } else { MOST_WASTE[0] * area + MOST_WASTE[1] };
    let packs_well =
        area >= LEAST_BOX_FILL * box_area || box_area - area <= waste(surface, a) + waste(surface, b) + allowed;
    packs_well.then_some(union)
}

fn area(surface: &Surface, flat: &FlatChart) -> f64 {
    flat.chart.faces.iter().map(|&f| surface.area[f as usize]).sum()
}

/// Area of the bounding box that the chart leaves empty.
fn waste(surface: &Surface, flat: &FlatChart) -> f64 {
    smallest_box(&flat.uv).area - area(surface, flat)
}

/// Untried neighbours, best first, each chart at most once.
fn disjoint_pairs(
    surface: &Surface,
    charts: &[Option<FlatChart>],
    refused: &BTreeSet<(usize, usize)>,
) -> Vec<(usize, usize)> {
    let borders = Borders::of(surface, charts);
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
    shared: BTreeMap<(usize, usize), f64>,
    perimeter: Vec<f64>,
    area: Vec<f64>,
    texels: Vec<f64>,
}

impl Borders {
    fn of(surface: &Surface, charts: &[Option<FlatChart>]) -> Self {
        let mut owner = vec![usize::MAX; surface.faces()];
        for (c, chart) in charts.iter().enumerate() {
            for &f in chart.iter().flat_map(|c| &c.chart.faces) {
                owner[f as usize] = c;
            }
        }
        let n = charts.len();
        let mut out =
            Self { shared: BTreeMap::new(), perimeter: vec![0.0; n], area: vec![0.0; n], texels: vec![0.0; n] };
        for f in 0..surface.faces() {
            let a = owner[f];
            if a == usize::MAX {
                continue;
            }
            out.area[a] += surface.area[f];
            out.texels[a] += surface.area[f] * surface.density[f];
            for h in 3 * f..3 * f + 3 {
                let other = surface.opposite[h];
                let b = if other == NONE { usize::MAX } else { owner[other as usize / 3] };
                if a == b {
                    continue;
                }
                out.perimeter[a] += surface.length[h];
                if b != usize::MAX && a < b {
                    *out.shared.entry((a, b)).or_default() += surface.length[h];
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::split::flatten;
    use super::super::tests::cylinder;
    use super::*;

    #[test]
    fn strips_of_a_cylinder_join_until_they_would_close_up() {
        let surface = Surface::new(&cylinder(24), None);
        let limits = Limits { stretch: 1.1 };
        let strips: Vec<FlatChart> =
            (0..48).step_by(6).flat_map(|f| flatten(&surface, (f..f + 6).collect(), &limits)).collect();
        let joined = join(&surface, strips, &limits, &Cancellation::default());
        assert_eq!(joined.len(), 2);
    }
}
