//! Levels that keep the source's materials, where its own triangles can mostly stay.

use super::level_maker::{LevelMaker, Made};
use super::level_whole::is_short;
use super::report::{LevelReport, LevelTopology};
use super::runner::Runner;
use super::source::SourceIndex;
use crate::data::{AlphaMode, LayerMaterial, Level, LevelLayer, LevelMesh, LevelTextures, Model, Surface, TriMesh};
use crate::geometry::first_coincident;
use crate::simplify::{self, Importance, Reduced, ReductionInputs};
use crate::skinning;
use crate::{Error, Source, StageId};

/// Triangles of a source for each face of a budget, at most: of more, collapses onto vertices of the source lose to those that
/// place vertices.
const MOST_TRIANGLES_PER_FACE: usize = 64;
/// Decibels by which a level with the source's materials must look more like the source, for each draw call that it costs more
/// than a level with one material.
const DECIBELS_PER_DRAW_CALL: f32 = 0.1;

/// Reduces the source to budgets that are a good part of it. The levels that look more like it stay, also in their worst views.
pub(super) fn replace(source: &Source<'_>, maker: &LevelMaker<'_>, made: &mut Made) -> Result<(), Error> {
    let is_near =
        |report: &LevelReport| maker.source_faces() <= MOST_TRIANGLES_PER_FACE.saturating_mul(report.budget as usize);
    let near: Vec<usize> = (0..made.reports.len()).filter(|&i| is_near(&made.reports[i])).collect();
    let model = maker.source.index.whole;
    if near.is_empty() || !may_keep_materials(maker, model) {
        return Ok(());
    }
    let budgets: Vec<u32> = near.iter().map(|&i| made.reports[i].budget).collect();
    let reduced = maker.run.time(StageId::Simplify, || reduce(source, maker, &budgets))?;
    let Some(pictures) = &maker.pictures else { return Ok(()) };
    for (i, reduced) in near.into_iter().zip(reduced) {
        let Some(reduced) = reduced else { continue };
        let level = level(&reduced.surface, &made.levels[i]);
        maker.run.validate(StageId::Simplify, || level.validate());
        let likeness = maker.run.time(StageId::Views, || pictures.compare(&level));
        let draw_calls = level.layers.len().saturating_sub(made.levels[i].layers.len());
        let report = report(maker, &reduced, &level, &made.reports[i]);
        let level = Level { error: report.error, ..level };
        let report = LevelReport { likeness: Some(likeness), ..report };
        let gain = report.mean_psnr() - made.reports[i].mean_psnr();
        // Walls that are exact in most views must not hide bars that are missing in one.
        let is_worse_somewhere = report.worst_psnr() < made.reports[i].worst_psnr();
        tracing::debug!(budget = report.budget, gain, draw_calls, "reduction");
        if gain > DECIBELS_PER_DRAW_CALL * draw_calls as f32 && !is_worse_somewhere {
            let warning = maker.params.gate.warning(&report);
            (made.levels[i], made.reports[i]) = (level, LevelReport { warning, ..report });
        }
    }
    Ok(())
}

/// A level may have the source's materials: they use no other texture coordinates than the surface has.
fn may_keep_materials(maker: &LevelMaker<'_>, model: &Model) -> bool {
    maker.params.keep_materials && model.materials.iter().all(|material| material.uv_sets == [0, 1])
}

fn reduce(source: &Source<'_>, maker: &LevelMaker<'_>, budgets: &[u32]) -> Result<Vec<Option<Reduced>>, Error> {
    let LevelMaker { params, run, .. } = *maker;
    let index = maker.source.index;
    if std::ptr::eq(index.model, index.whole) {
        return Ok(reduce_indexed(index, maker.source.importance.as_ref(), maker, budgets));
    }
    let run: Runner<'_> = run.silent();
    let index = SourceIndex::new(source, (index.whole, index.whole), &params.views, &run)?;
    let importance = Importance::of(index.whole, &params.importance)?;
    Ok(reduce_indexed(&index, importance.as_ref(), maker, budgets))
}

fn reduce_indexed(
    index: &SourceIndex<'_>,
    importance: Option<&Importance>,
    maker: &LevelMaker<'_>,
    budgets: &[u32],
) -> Vec<Option<Reduced>> {
    let inputs = ReductionInputs {
        model: index.whole,
        poses: index.poses.as_ref(),
        importance,
        params: &maker.params.collapse,
        cancellation: maker.run.cancellation(),
    };
    simplify::reduce(&inputs, budgets)
}

/// A reduced surface as a level, in place of another of the same budget.
fn level(surface: &Surface, other: &Level) -> Level {
    let layers = surface.material.chunk_by(|a, b| a == b);
    let layers = layers.map(|run| LevelLayer { triangles: run.len(), material: LayerMaterial::Source(run[0]) });
    let morphs = if other.mesh.morphs.is_empty() { Vec::new() } else { skinning::surface_morphs(surface) };
    let mesh = LevelMesh {
        positions: surface.positions.clone(),
        normals: surface.normals.clone(),
        tangents: surface.tangents.clone(),
        uvs: surface.uvs[0].clone(),
        second_uvs: surface.uvs[1].clone(),
        colors: surface.colors.clone(),
        influences: surface.influences.clone(),
        triangles: surface.triangles.clone(),
        morphs,
    };
    let textures = LevelTextures {
        base_color: None,
        normal: None,
        occlusion_roughness_metallic: None,
        emissive: None,
        format: other.textures.format,
    };
    Level { budget: other.budget, error: 0.0, mesh, own_joints: other.own_joints, layers: layers.collect(), textures }
}

/// The report of a reduced level, in place of another of the same budget.
fn report(maker: &LevelMaker<'_>, reduced: &Reduced, level: &Level, other: &LevelReport) -> LevelReport {
    let (budget, faces) = (other.budget, level.mesh.triangles.len() as u32);
    let whole = shape(&reduced.surface, |_| true);
    // Distances are those of the solid surface, if there is one.
    let is_clear = |material: u32| {
        let material = &maker.source.index.whole.materials[material as usize];
        material.alpha_mode == AlphaMode::Blend || material.transmission.is_some()
    };
    let solid = shape(&reduced.surface, |material| !is_clear(material));
    let deviation = maker.source.deviation_metric.measure(if solid.triangles.is_empty() { &whole } else { &solid });
    LevelReport {
        level: other.level,
        budget,
        faces,
        stopped: is_short(faces, budget).then(|| reduced.shortfall.to_string()),
        candidate: "reduction".into(),
        error: deviation.percentile_95,
        deviation,
        topology: LevelTopology::of(&whole),
        charts: 0,
        fill: 0.0,
        stretch: 0.0,
        worst_stretch: 0.0,
        clear: Vec::new(),
        lattices: 0,
        refined: None,
        device: None,
        likeness: None,
        warning: None,
    }
}

/// The triangles of some materials, joined where their corners coincide.
fn shape(surface: &Surface, shows: impl Fn(u32) -> bool) -> TriMesh {
    let first = first_coincident(&surface.positions);
    let triangles = surface.triangles.iter().zip(&surface.material).filter(|(_, material)| shows(**material));
    let triangles = triangles.map(|(triangle, _)| triangle.map(|v| first[v as usize])).collect();
    TriMesh { positions: surface.positions.clone(), triangles }.filtered(|_| true)
}
