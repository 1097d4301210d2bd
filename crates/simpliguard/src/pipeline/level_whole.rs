//! The whole of a level: its solid layer and those beside it in one mesh, with one atlas and one set of textures.

use std::iter;

use glam::Vec4;

use super::extra_layers::{ExtraLayer, transmission};
use super::layers::CUTOFF;
use super::level_task::LevelTask;
use super::likeness::SourcePictures;
use super::report::{ClearReport, LevelReport, LevelTopology, Likeness};
use crate::data::{
    AlphaMode, Atlas, Influences, LayerMaterial, Level, LevelLayer, LevelMaterial, LevelMorph, Transmission, TriMesh,
    linear_to_srgb,
};
use crate::refine::{LowPoly, Refined};
use crate::render::{SurfaceSample, fill_unknown};
use crate::simplify::LayerShape;
use crate::skinning::{self, SkinSource};
use crate::texture::{self, BakeTarget, Channels, TexelMap};

/// Least fraction of a budget that needs no reason.
const FULL_BUDGET: f64 = 0.98;

/// A level has so few faces that the report gives the reason.
pub(super) fn is_short(faces: u32, budget: u32) -> bool {
    f64::from(faces) < FULL_BUDGET * f64::from(budget)
}

/// The solid layer of a level with its final texture.
pub(super) struct Finished {
    pub(super) low: LowPoly,
    pub(super) influences: Vec<Influences>,
    /// Samples of the source at each texel.
    pub(super) samples: Vec<Option<SurfaceSample>>,
    /// Its outline is in its texture.
    pub(super) cut_out: bool,
    pub(super) refined: Option<Refined>,
    pub(super) device: Option<String>,
}

/// A level on its way from layers to one mesh.
pub(super) struct WholeLevel {
    mesh: TriMesh,
    atlas: Atlas,
    texels: TexelMap,
    influences: Vec<Influences>,
    morphs: Vec<LevelMorph>,
    /// Samples of the source at each texel.
    samples: Vec<Option<SurfaceSample>>,
    /// Encoded colours of each texel, gutters included.
    colors: Vec<Vec4>,
    layers: Vec<Layer>,
    clear: Vec<ClearReport>,
    /// Cards that stand for lattices.
    lattices: u32,
    /// Faces of the solid layer.
    solid_faces: usize,
    refined: Option<Refined>,
    /// The GPU that moved the vertices, or fitted the texture.
    device: Option<String>,
}

/// A layer before its textures are made.
#[derive(Clone, Copy)]
struct Layer {
    faces: usize,
    alpha_mode: AlphaMode,
    double_sided: bool,
    unlit: bool,
    transmission: Option<Transmission>,
}

impl WholeLevel {
    /// The solid layer alone.
    pub(super) fn of_solid(task: &LevelTask<'_>, finished: Finished, atlas: &Atlas, texels: TexelMap) -> Self {
        let Finished { low, influences, samples, cut_out, refined, device } = finished;
        let (source, mesh) = (task.all.source, low.mesh());
        let model = source.index.model;
        let layer = Layer {
            faces: mesh.triangles.len(),
            alpha_mode: if cut_out { AlphaMode::Mask { cutoff: CUTOFF } } else { AlphaMode::Opaque },
            double_sided: low.double_sided,
            unlit: model.materials.iter().all(|m| m.unlit),
            transmission: transmission(model),
        };
        Self {
            atlas: atlas.clone(),
            texels,
            influences,
            morphs: morphs(task, &source.skin_source, &mesh),
            samples,
            colors: low.texture.texels,
            layers: if mesh.triangles.is_empty() { Vec::new() } else { vec![layer] },
            clear: Vec::new(),
            lattices: 0,
            solid_faces: mesh.triangles.len(),
            mesh,
            refined,
            device,
        }
    }

    /// Adds the layers beside the solid one, whose texture coordinates are in `atlas`.
    pub(super) fn add_extra_layers(&mut self, task: &LevelTask<'_>, atlas: &Atlas) {
        let mut first = 0;
        for (layer, shape) in task.extra() {
            let faces = first..first + shape.mesh.triangles.len();
            first = faces.end;
            self.add_layer(task, (layer, shape), &atlas.part(faces));
        }
        if first > 0 {
            self.texels = TexelMap::new(&self.atlas, self.texels.size);
            // What shows nothing has no colour of its own: black there would be filtered into the edges of what shows.
            let known: Vec<bool> =
                self.samples.iter().map(|s| s.as_ref().is_some_and(SurfaceSample::is_seen)).collect();
            fill_unknown(&mut self.colors, &known, self.texels.size);
        }
    }

    fn add_layer(&mut self, task: &LevelTask<'_>, (layer, shape): (&ExtraLayer<'_>, &LayerShape), atlas: &Atlas) {
        let (source, mesh) = (&layer.source, &shape.mesh);
        let index = source.index;
        let baker = index.baker();
        let texels = TexelMap::new(atlas, self.texels.size);
        let cards = shape.cards.as_ref();
        let target = BakeTarget { mesh, atlas, texels: &texels, cards, keeps_area: false, parts: shape.parts.as_ref() };
        let samples = baker.bake(&target, task.run.cancellation());
        match &shape.cards {
            Some(cards) => self.lattices += cards.reach.len() as u32,
            None => self.clear.push(clear_report(layer, mesh, &samples)),
        }
        for (i, sample) in samples.into_iter().enumerate().filter(|(_, sample)| sample.is_some()) {
            self.colors[i] = sample.map_or(Vec4::ZERO, |s| s.color.truncate().map(linear_to_srgb).extend(1.0));
            self.samples[i] = sample;
        }
        self.layers.push(Layer {
            faces: mesh.triangles.len(),
            alpha_mode: layer.alpha_mode,
            double_sided: shape.double_sided,
            unlit: layer.is_unlit(),
            transmission: layer.transmission,
        });
        let poses = index.poses.as_ref().filter(|_| !task.run.cancellation().is_cancelled());
        self.influences.extend(skinning::skin(&source.skin_source, poses, mesh, &task.params.skinning));
        for (morph, extra) in self.morphs.iter_mut().zip(morphs(task, &source.skin_source, mesh)) {
            morph.positions.extend(extra.positions);
            morph.normals.extend(extra.normals);
        }
        self.mesh.append(mesh);
        self.atlas.uvs.extend_from_slice(&atlas.uvs);
        self.atlas.chart.extend_from_slice(&atlas.chart);
    }

    /// The level and its report.
    pub(super) fn finish(self, task: &LevelTask<'_>) -> (Level, LevelReport) {
        let report = self.report(task);
        let mut level = self.level(task, report.error);
        let likeness = task.all.pictures.map(|pictures| {
            let likeness = pictures.compare(&level);
            drop_useless_normal_map(&mut level, pictures, likeness)
        });
        let report = LevelReport { likeness, ..report };
        let warning = task.all.params.gate.warning(&report);
        (level, LevelReport { warning, ..report })
    }

    fn report(&self, task: &LevelTask<'_>) -> LevelReport {
        let (budget, shape, faces) = (task.budget, task.shape, self.mesh.triangles.len() as u32);
        // Distances are those of the solid layer, if there is one.
        let measured = if self.solid_faces == 0 { self.mesh.triangles.len() } else { self.solid_faces };
        let deviation = task.all.source.deviation_metric.measure(&self.mesh.filtered(|t| t < measured));
        LevelReport {
            level: task.number as u32,
            budget,
            faces,
            stopped: is_short(faces, budget).then(|| shape.shortfall.to_string()),
            candidate: shape.candidate.to_string(),
            error: deviation.percentile_95,
            deviation,
            topology: LevelTopology::of(&self.mesh),
            charts: self.atlas.charts as u32,
            fill: self.atlas.fill,
            stretch: self.atlas.stretch,
            worst_stretch: self.atlas.worst_stretch,
            clear: self.clear.clone(),
            lattices: self.lattices,
            refined: self.refined,
            device: self.device.clone(),
            likeness: None,
            warning: None,
        }
    }

    /// For each face, if it is seen from both sides.
    fn double_sided(&self) -> Vec<bool> {
        self.layers.iter().flat_map(|layer| iter::repeat_n(layer.double_sided, layer.faces)).collect()
    }

    /// The mesh with its morph targets, the texture set and the materials.
    fn level(self, task: &LevelTask<'_>, error: f32) -> Level {
        let params = task.all.params;
        let is_unlit = self.layers.iter().all(|layer| layer.unlit);
        let channels = Channels {
            normal: params.maps.normal_map && !is_unlit,
            alpha: self.layers.iter().any(|layer| layer.alpha_mode != AlphaMode::Opaque),
            format: params.maps.format,
        };
        let normals = texture::corner_normals(&self.mesh, &self.atlas, &self.texels, &self.samples);
        let inverted = texture::inverted_faces(&self.texels, &self.samples, &self.double_sided());
        let mut mesh =
            texture::level_mesh((&self.mesh, &self.atlas), &normals, &inverted, &self.influences, &self.morphs);
        if channels.normal {
            mesh.tangents = texture::tangents(&mesh);
        }
        let (textures, statistics) = texture::pbr_maps(&mesh, &self.texels, &self.samples, &self.colors, channels);
        if textures.normal.is_none() {
            mesh.tangents.clear();
        }
        // Tangents and normal maps are made for faces whose normals point to their front.
        texture::turn_inverted(&mut mesh, &inverted);
        let layer = |layer: Layer| {
            let Layer { faces, alpha_mode, double_sided, unlit, transmission } = layer;
            let material = texture::level_material(&statistics, alpha_mode, double_sided, unlit);
            LevelLayer { triangles: faces, material: LayerMaterial::Baked(LevelMaterial { transmission, ..material }) }
        };
        let layers = self.layers.into_iter().map(layer).collect();
        let own_joints = task.params.skinning.bone_faces > 0.0;
        Level { budget: task.budget, error, mesh, own_joints, layers, textures }
    }
}

fn clear_report(layer: &ExtraLayer<'_>, mesh: &TriMesh, samples: &[Option<SurfaceSample>]) -> ClearReport {
    let known: Vec<f32> = samples.iter().flatten().map(|s| s.color.w).collect();
    ClearReport {
        faces: mesh.triangles.len() as u32,
        alpha: known.iter().sum::<f32>() / known.len().max(1) as f32,
        transmits: layer.transmission.is_some(),
    }
}

/// Drops the normal map if the level looks at least as much like its source under light without it: bytes for normals are
/// coarser than those of a smooth mesh. A source with normal maps keeps them: they also show from nearer by. Returns the
/// likeness.
fn drop_useless_normal_map(level: &mut Level, pictures: &SourcePictures<'_>, likeness: Likeness) -> Likeness {
    if pictures.have_normal_maps() {
        return likeness;
    }
    let Some(map) = level.textures.normal.take() else { return likeness };
    let tangents = std::mem::take(&mut level.mesh.tangents);
    let without = pictures.compare(level);
    if without.psnr_lit >= likeness.psnr_lit {
        return without;
    }
    (level.textures.normal, level.mesh.tangents) = (Some(map), tangents);
    likeness
}

/// The morph targets of a part of a level, if they are transferred.
fn morphs(task: &LevelTask<'_>, source: &SkinSource<'_>, mesh: &TriMesh) -> Vec<LevelMorph> {
    if task.all.params.maps.morphs { skinning::transfer_morphs(source, mesh) } else { Vec::new() }
}
