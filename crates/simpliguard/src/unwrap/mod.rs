//! Texture coordinates of a level.
//!
//! Charts are grown by normals (`cluster`; Garland et al. 2001, Cohen-Steiner et al. 2004), laid flat by least squares
//! conformal maps evened out by as-rigid-as-possible steps (`lscm`; Levy et al. 2002, Liu et al. 2008), split where
//! that fails (`split`), joined where two lie flat as one (`join`) and placed on the texel grid (`pack`). The result has
//! no flipped face and no overlap for any input: edges that are not manifold are cut, faces without area are fattened,
//! and a single face can always be laid flat.
//!
//! Limits: a closed or ring-shaped part of more than a twentieth of the surface is cut into at least two charts; a chart has one texel density, the mean of its
//! faces'. Faces thinner than a hundredth of their length are widened to that; those thinner than a millionth of the
//! atlas side are taken out of their charts. Where an atlas is so small that the gutters leave no room, gutters shrink,
//! in the end to nothing.

mod bitmap;
mod chart;
mod cluster;
mod hull;
mod join;
mod lscm;
mod pack;
mod piece;
mod quality;
mod raster;
mod seam;
mod solver;
mod split;
mod strip;
mod surface;
#[cfg(test)]
mod tests;

use glam::{DVec2, Vec2};
use rayon::prelude::*;

use crate::Cancellation;
use crate::data::{Atlas, TriMesh};
use chart::FlatChart;
use pack::Layout;
use quality::Limits;
use surface::{Surface, doubled_area};

pub use raster::{flips, overlaps};

/// Stretch above which a chart is split.
const SPLIT_STRETCH: f64 = 1.3;

/// Stretch up to which two charts are joined.
const JOIN_STRETCH: f64 = 1.06;

/// Least height of a face in the atlas as a fraction of the atlas side: some ten steps of `f32`.
const LEAST_HEIGHT: f64 = 1e-6;

/// Times that faces below the least height are taken out of their charts; then those charts fall apart.
const RESCUES: usize = 3;

/// Size and spacing of an atlas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnwrapParams {
    /// Side of the square atlas in texels; at least 1.
    pub size: u32,
    /// Least number of uncovered texels between two charts. Half of it, rounded up, is kept to the border, so that
    /// charts stay as far apart across a repeating border.
    pub gutter: u32,
}

impl Default for UnwrapParams {
    fn default() -> Self {
        Self { size: 1024, gutter: 4 }
    }
}

/// Gives every face of `mesh` its own place in a square texture.
///
/// `importance` is the relative linear texel density of each face (1 = normal, clamped to `1/16..=16`); a chart gets the
/// mean of its faces. It never fails: degenerate faces, non-manifold edges and pinched vertices are allowed, and a
/// chart too small for a texel is enlarged to one. An empty mesh gives an empty atlas. Equal inputs give equal bytes
/// for any number of threads. The atlas of a cancelled bake is empty or unfinished.
pub fn unwrap(mesh: &TriMesh, importance: Option<&[f32]>, params: &UnwrapParams, cancellation: &Cancellation) -> Atlas {
    let surface = Surface::new(mesh, importance);
    let split_limits = Limits { stretch: SPLIT_STRETCH };
    let charts: Vec<Vec<FlatChart>> = cluster::cluster(&surface)
        .into_par_iter()
        .take_any_while(|_| !cancellation.is_cancelled())
        .map(|faces| split::flatten(&surface, faces, &split_limits))
        .collect();
    let charts = charts.into_iter().flatten().collect();
    let mut charts = join::join(&surface, charts, &Limits { stretch: JOIN_STRETCH }, cancellation);
    let mut rescues = 0;
    loop {
        if cancellation.is_cancelled() {
            return Atlas::default();
        }
        charts.sort_by_key(|c| c.chart.faces[0]);
        let layout = pack::pack(&surface, &charts, params, cancellation);
        let collapsed: Vec<Vec<bool>> = charts.iter().zip(&layout.uv).map(|(c, uv)| collapsed_faces(c, uv)).collect();
        if !collapsed.iter().flatten().any(|&c| c) {
            return atlas(&surface, &charts, &layout, params);
        }
        rescues += 1;
        let keep_rest = rescues <= RESCUES;
        let rescue = |(flat, lost): (FlatChart, Vec<bool>)| {
            if !lost.contains(&true) {
                return vec![flat];
            }
            let alone = |i: usize| lost[i] || !keep_rest;
            let pieces = split::without(&surface, &flat.chart.faces, alone);
            pieces.into_iter().flat_map(|faces| split::flatten(&surface, faces, &split_limits)).collect()
        };
        charts = charts.into_iter().zip(collapsed).flat_map(rescue).collect();
    }
}

/// For each face whether it loses its orientation, or nearly so, when its corners are rounded to `f32`. A chart of one
/// face is enlarged where it is small and fattened where it is thin, so it never does.
fn collapsed_faces(flat: &FlatChart, uv: &[DVec2]) -> Vec<bool> {
    let several = flat.chart.faces.len() > 1;
    let collapsed = |i: usize| {
        let t = flat.chart.triangle(uv, i).map(|p| p.as_vec2().as_dvec2());
        let longest = (0..3).map(|k| t[k].distance(t[(k + 1) % 3])).fold(0.0, f64::max);
        several && doubled_area(&t) <= LEAST_HEIGHT * longest
    };
    (0..flat.chart.faces.len()).map(collapsed).collect()
}

fn atlas(surface: &Surface, charts: &[FlatChart], layout: &Layout, params: &UnwrapParams) -> Atlas {
    let mut uvs = vec![[Vec2::ZERO; 3]; surface.faces()];
    let mut chart = vec![0; surface.faces()];
    let (mut energy, mut area, mut worst) = (0.0, 0.0, 1.0f64);
    for (c, (flat, uv)) in charts.iter().zip(&layout.uv).enumerate() {
        energy += quality::stretch_energy(surface, &flat.chart, &flat.uv);
        worst = worst.max(quality::worst_stretch(surface, &flat.chart, &flat.uv));
        for (i, &f) in flat.chart.faces.iter().enumerate() {
            uvs[f as usize] = flat.chart.triangle(uv, i).map(|p| p.as_vec2().clamp(Vec2::ZERO, Vec2::ONE));
            chart[f as usize] = c as u32;
            area += surface.area[f as usize];
        }
    }
    Atlas {
        fill: raster::fill(&uvs, params.size.max(1)),
        uvs,
        chart,
        charts: charts.len(),
        stretch: if area > 0.0 { (energy / area).sqrt() as f32 } else { 1.0 },
        worst_stretch: worst as f32,
        texels_per_unit: (layout.density * f64::from(params.size.max(1)) * surface.units) as f32,
    }
}
