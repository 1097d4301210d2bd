//! Texture coordinates of a level.
//!
//! 1. Grow charts by normals (`cluster`; Garland et al. 2001, Cohen-Steiner et al. 2004).
//! 2. Lay each chart flat by a least squares conformal map, evened out by as-rigid-as-possible steps (`lscm`; Levy et
//!    al. 2002, Liu et al. 2008), and bisect the charts for which that fails (`flatten`).
//! 3. Join neighbouring charts whose union lies flat as well (`join`).
//! 4. Place the charts on the texel grid (`pack`).
//!
//! The result has no flipped face and no overlap for any input. Edges that are not manifold are cut, faces without area
//! are fattened, and a single face can always be laid flat.
//!
//! Limits: a closed or ring-shaped part of more than a twentieth of the surface is cut into at least two charts. A
//! chart has one texel density, the mean of its faces' densities. Faces thinner than a hundredth of their length are
//! widened to that; faces thinner than a millionth of the atlas side are taken out of their charts. Where an atlas is
//! so small that the gutters leave no room, the gutters shrink, in the end to nothing.

mod bitmap;
mod chart;
mod cluster;
mod coverage;
mod flatten;
mod half_edge_mesh;
mod hull;
mod join;
mod lscm;
mod pack;
mod params;
mod piece;
mod quality;
mod seam;
mod solver;
mod strip;
#[cfg(test)]
mod tests;
mod texel_grid;

use glam::{DVec2, Vec2};
use rayon::prelude::*;

use crate::Cancellation;
use crate::data::{Atlas, TriMesh};
use crate::geometry::doubled_area;
use chart::FlatChart;
use half_edge_mesh::HalfEdgeMesh;
use pack::Layout;
use quality::StretchLimit;

pub use coverage::{flips, overlaps};
pub use params::UnwrapParams;

/// Stretch above which a chart is bisected.
const FLATTEN_LIMIT: StretchLimit = StretchLimit(1.3);

/// Stretch up to which two charts are joined.
const JOIN_LIMIT: StretchLimit = StretchLimit(1.06);

/// Least height of a face in the atlas as a fraction of the atlas side: some ten steps of `f32`.
const LEAST_HEIGHT: f64 = 1e-6;

/// Number of times that faces below the least height are taken out of their charts. After that, each face of such a
/// chart becomes a chart of its own.
const RESCUES: usize = 3;

/// Gives every face of `mesh` its own place in a square texture.
///
/// `texel_density` is the relative linear texel density of each face (1 = normal, clamped to `1/16..=16`); a chart gets
/// the mean of its faces. It never fails: degenerate faces, non-manifold edges and pinched vertices are allowed, and a
/// chart too small for a texel is enlarged to one. An empty mesh gives an empty atlas. Equal inputs give equal bytes
/// for any number of threads. The atlas of a cancelled bake is empty or unfinished.
pub fn unwrap(
    mesh: &TriMesh,
    texel_density: Option<&[f32]>,
    params: &UnwrapParams,
    cancellation: &Cancellation,
) -> Atlas {
    let mesh = HalfEdgeMesh::new(mesh, texel_density);
    let charts = join::join(&mesh, flat_charts(&mesh, cancellation), JOIN_LIMIT, cancellation);
    pack_soundly(&mesh, charts, params, cancellation)
}

/// Charts of similar normals, laid flat; some are missing if cancelled.
fn flat_charts(mesh: &HalfEdgeMesh, cancellation: &Cancellation) -> Vec<FlatChart> {
    let charts: Vec<Vec<FlatChart>> = cluster::cluster(mesh)
        .into_par_iter()
        .take_any_while(|_| !cancellation.is_cancelled())
        .map(|faces| flatten::flatten(mesh, faces, FLATTEN_LIMIT))
        .collect();
    charts.into_iter().flatten().collect()
}

/// Packs the charts. Where faces collapse in the atlas, takes them out of their charts and packs again.
fn pack_soundly(
    mesh: &HalfEdgeMesh,
    mut charts: Vec<FlatChart>,
    params: &UnwrapParams,
    cancellation: &Cancellation,
) -> Atlas {
    let mut rescues = 0;
    while !cancellation.is_cancelled() {
        charts.sort_by_key(|c| c.chart.faces[0]);
        let layout = pack::pack(mesh, &charts, params, cancellation);
        let collapsed: Vec<Vec<bool>> = charts.iter().zip(&layout.uv).map(|(c, uv)| collapsed_faces(c, uv)).collect();
        if !collapsed.iter().flatten().any(|&c| c) {
            return atlas(mesh, &charts, &layout, params);
        }
        rescues += 1;
        let keep_rest = rescues <= RESCUES;
        let rescue = |(flat, collapsed): (FlatChart, Vec<bool>)| {
            if !collapsed.contains(&true) {
                return vec![flat];
            }
            let is_alone = |i: usize| collapsed[i] || !keep_rest;
            let pieces = flatten::isolate(mesh, &flat.chart.faces, is_alone);
            pieces.into_iter().flat_map(|faces| flatten::flatten(mesh, faces, FLATTEN_LIMIT)).collect()
        };
        charts = charts.into_iter().zip(collapsed).flat_map(rescue).collect();
    }
    Atlas::default()
}

/// Flags of the faces that lose their orientation, or nearly so, when their corners are rounded to `f32`. A chart of
/// one face is enlarged where it is small and fattened where it is thin, so its face never does.
fn collapsed_faces(flat: &FlatChart, uv: &[DVec2]) -> Vec<bool> {
    let several = flat.chart.faces.len() > 1;
    let collapsed = |i: usize| {
        let t = flat.chart.triangle(uv, i).map(|p| p.as_vec2().as_dvec2());
        let longest = (0..3).map(|k| t[k].distance(t[(k + 1) % 3])).fold(0.0, f64::max);
        several && doubled_area(&t) <= LEAST_HEIGHT * longest
    };
    (0..flat.chart.faces.len()).map(collapsed).collect()
}

/// The atlas of charts in a layout, with its measures.
fn atlas(mesh: &HalfEdgeMesh, charts: &[FlatChart], layout: &Layout, params: &UnwrapParams) -> Atlas {
    let mut uvs = vec![[Vec2::ZERO; 3]; mesh.faces()];
    let mut chart = vec![0; mesh.faces()];
    let (mut energy, mut area, mut worst) = (0.0, 0.0, 1.0f64);
    for (c, (flat, uv)) in charts.iter().zip(&layout.uv).enumerate() {
        energy += quality::stretch_energy(mesh, &flat.chart, &flat.uv);
        worst = worst.max(quality::worst_stretch(mesh, &flat.chart, &flat.uv));
        for (i, &f) in flat.chart.faces.iter().enumerate() {
            uvs[f as usize] = flat.chart.triangle(uv, i).map(|p| p.as_vec2().clamp(Vec2::ZERO, Vec2::ONE));
            chart[f as usize] = c as u32;
            area += mesh.area[f as usize];
        }
    }
    Atlas {
        fill: coverage::fill(&uvs, params.size.max(1)),
        uvs,
        chart,
        charts: charts.len(),
        stretch: if area > 0.0 { (energy / area).sqrt() as f32 } else { 1.0 },
        worst_stretch: worst as f32,
        texels_per_unit: (layout.density * f64::from(params.size.max(1)) * mesh.units) as f32,
    }
}
