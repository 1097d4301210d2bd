//! From a shape to a finished level: unwrap, texture, refine, rig.

use std::sync::{Mutex, PoisonError};

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::animation::{Motions, Poses};
use crate::data::Candidate;
use crate::data::{Atlas, Cards, Influences, Level, Model, TriMesh, linear_to_srgb};
use crate::geometry::{BoundingSphere, Bvh};
use crate::pipeline::clock::Clock;
use crate::pipeline::store::{atlas_key, vertices_key, warm_start_key};
use crate::pipeline::{LevelReport, LevelTopology};
use crate::refine::{self, LowPoly, Refined, Skin, Solver, TexelGrid, TextureAdam, TextureFit};
use crate::render::{SurfaceSample, SurfaceSampler, View, ViewRenderer, fill_unknown};
use crate::settings::{BakeSettings, InitialTexture, MorphTargets, SkinTransfer, TextureSolver};
use crate::simplify::{self, DeviationMetric, JointPlanes, Shape};
use crate::skinning::{self, BoneRemap, JointSplit, SkinSource, Transfer};
use crate::texture::{self, BakeTarget, Baker, Channels, TexelMap};
use crate::unwrap::{UnwrapParams, unwrap};
use crate::{Context, Error, Key, Progress, ProgressSink, StageId};

/// Part of the whole bake that is done when the levels begin.
pub(crate) const LEVELS_BEGIN: f32 = 0.4;
/// Largest texture during descent: a view resolves no more, and the last solution is at full size.
const FITTED_SIZE: usize = 512;
/// Most faces of a level whose vertices are moved at half size: the edges of others are but a few pixels long there.
const COARSE_FACES: u32 = 2000;
/// Such a level takes this many times the steps of one that is refined at full size alone.
const COARSE_MORE: u32 = 3;
/// Difference of colours at which a pixel counts half in the last solution.
const TRUST: f32 = 0.3;
/// Encoded grey of a texture that has not been made.
const GREY: Vec4 = Vec4::new(0.5, 0.5, 0.5, 1.0);

/// What all levels share.
#[derive(Clone, Copy)]
pub(crate) struct Shared<'a> {
    pub(crate) model: &'a Model,
    pub(crate) sampler: &'a SurfaceSampler<'a>,
    pub(crate) bvh: &'a Bvh,
    pub(crate) skin_source: &'a SkinSource<'a>,
    pub(crate) deviation_metric: &'a DeviationMetric<'a>,
    pub(crate) frame: BoundingSphere,
    pub(crate) views: &'a [View],
    pub(crate) view_renderer: &'a ViewRenderer<'a>,
    /// Its views at half the size, unless no level is expected to need them.
    pub(crate) halves: Option<&'a [View]>,
    pub(crate) poses: Option<&'a Poses<'a>>,
    pub(crate) planes: &'a JointPlanes,
    pub(crate) seed: u64,
    /// Of the source's files, if stages are stored.
    pub(crate) content: Option<Key>,
    pub(crate) settings: &'a BakeSettings,
    /// Shown while the result is made: vertices may lie where an earlier bake of other pictures has left them.
    pub(crate) preview: bool,
    pub(crate) context: &'a Context<'a>,
    pub(crate) clock: &'a Clock,
}

/// A mesh with its place in the atlas.
struct Canvas<'a> {
    shared: &'a Shared<'a>,
    atlas: &'a Atlas,
    size: usize,
    texels: TexelMap,
}

/// Makes a level for each budget from its shape.
pub(crate) fn make_levels(
    shared: &Shared<'_>,
    wanted: &[(u32, &Shape)],
) -> Result<(Vec<Level>, Vec<LevelReport>), Error> {
    let told = vec![LEVELS_BEGIN; wanted.len()];
    let overall = shared.context.progress.map(|sink| Overall { sink, levels: Mutex::new(told) });
    let progress = overall.as_ref().map(|overall| overall as &dyn ProgressSink);
    let context = Context { progress, ..shared.context.clone() };
    let shared = &Shared { context: &context, ..*shared };
    let make = |(i, &(budget, shape)): (usize, &(u32, &Shape))| make_level(shared, i as u32 + 1, budget, shape);
    let made: Result<Vec<_>, Error> = wanted.par_iter().enumerate().map(make).collect();
    Ok(made?.into_iter().unzip())
}

/// How far all levels are: the mean of how far each is, whether they are made together or one after the other.
struct Overall<'a> {
    sink: &'a dyn ProgressSink,
    /// What each has told.
    levels: Mutex<Vec<f32>>,
}

impl ProgressSink for Overall<'_> {
    fn report(&self, progress: Progress) {
        let mut levels = self.levels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(level) = progress.level.and_then(|number| levels.get_mut(number - 1)) {
            *level = level.max(progress.fraction);
        }
        let fraction = levels.iter().sum::<f32>() / levels.len() as f32;
        // Still under the lock, so that a report is not overtaken by a later one.
        self.sink.report(Progress { fraction, ..progress });
    }
}

/// Makes level `number` (from 1) of `budget` faces from its shape.
fn make_level(shared: &Shared<'_>, number: u32, budget: u32, shape: &Shape) -> Result<(Level, LevelReport), Error> {
    let Shared { model, settings, context, clock, .. } = *shared;
    context.check(&model.name)?;
    // Cards have their outline in the texture.
    let size = if shape.cards.is_some() { settings.texture_size } else { texture_size(settings, budget) } as usize;
    let params = UnwrapParams { size: size as u32, gutter: settings.gutter };
    context.report(StageId::Unwrap, Some(number as usize), LEVELS_BEGIN);
    let atlas = clock.time(StageId::Unwrap, || {
        let density = simplify::texel_density(&shape.mesh, &shared.frame, shape.double_sided, &context.cancellation);
        let key = context.key(|| atlas_key(&shape.mesh, &density, &params));
        context.stored(key, || Ok(unwrap(&shape.mesh, Some(&density), &params, &context.cancellation)))
    })?;
    context.check(&model.name)?;
    context.report(StageId::Rig, Some(number as usize), 0.42);
    let influences = clock.time(StageId::Rig, || influences(shared, &shape.mesh));
    let still = shape.cards.is_some() || !settings.refine || settings.refine_steps == 0;
    let fitted = match still {
        true => Fitted::unmoved(shared, &atlas, shape, influences),
        false => fit(shared, &atlas, size, shape, influences, number, budget)?,
    };
    let (Fitted { mut low, influences, refined }, atlas) = match shape.cards {
        Some(_) => (fitted, atlas),
        None => split_at_joints(shared, fitted, atlas, budget),
    };
    let canvas = Canvas::new(shared, &atlas, size);
    let mesh = low.mesh();
    context.check(&model.name)?;
    context.report(StageId::Texture, Some(number as usize), 0.85);
    let samples = clock.time(StageId::Texture, || canvas.bake(&mesh, shape.cards.as_ref()));
    context.check(&model.name)?;
    let alpha = refined.is_none() && is_cut_out(shape, &samples);
    low.double_sided |= alpha;
    let (low, fit) = clock.time(StageId::Refine, || canvas.finish(low, &samples, alpha));
    context.check(&model.name)?;
    // The differentiable renderer does not see through a cut-out.
    let refined = (!alpha).then_some(Refined { psnr: fit.psnr, ..refined.unwrap_or(fit) });

    let unlit = model.materials.iter().all(|m| m.unlit);
    let channels = Channels { normal: settings.normal_map && !unlit, alpha, format: settings.texture_format };
    let topology = LevelTopology::of(&mesh);
    context.check(&model.name)?;
    let deviation = shared.deviation_metric.measure(&mesh);
    context.check(&model.name)?;
    let (mesh, textures, material) = clock.time(StageId::Texture, || {
        let morphs = match settings.morph_targets {
            MorphTargets::Transfer => skinning::transfer_morphs(shared.skin_source, &mesh),
            MorphTargets::Drop => Vec::new(),
        };
        let mesh = texture::level_mesh(&mesh, &atlas, &influences, &morphs, channels.normal);
        let (textures, varying) = texture::pbr_maps(&mesh, &canvas.texels, &samples, &low.texture.texels, channels);
        (mesh, textures, texture::level_material(&varying, alpha, low.double_sided, unlit))
    });
    context.check(&model.name)?;
    let faces = mesh.triangles.len() as u32;
    let report = LevelReport {
        level: number,
        budget,
        faces,
        stopped: (f64::from(faces) < 0.98 * f64::from(budget))
            .then(|| "small parts vanish several faces at a time, and the next would be one too many".to_owned()),
        candidate: shape.candidate.to_string(),
        error: deviation.percentile_95,
        deviation,
        topology,
        charts: atlas.charts as u32,
        fill: atlas.fill,
        stretch: atlas.stretch,
        worst_stretch: atlas.worst_stretch,
        refined,
    };
    Ok((
        Level {
            budget,
            error: deviation.percentile_95,
            mesh,
            own_joints: settings.bone_faces > 0.0,
            material,
            textures,
        },
        report,
    ))
}

/// A level's mesh with its vertices where they stay.
struct Fitted {
    low: LowPoly,
    influences: Vec<Influences>,
    /// What descent gained, unless there was none.
    refined: Option<Refined>,
}

impl Fitted {
    /// The shape as it is, without a texture.
    fn unmoved(shared: &Shared<'_>, atlas: &Atlas, shape: &Shape, influences: Vec<Influences>) -> Self {
        let mut low = LowPoly::new(&shape.mesh, atlas, shape.double_sided, TexelGrid::empty());
        let moved: Option<Vec<Vec3>> =
            shared.preview.then(|| shared.context.find(&warm_start_key(&shape.mesh))).flatten();
        if let Some(positions) = moved.filter(|positions| positions.len() == low.positions.len()) {
            low.positions = positions;
        }
        Self { low: low.with_motions(motions(shared, &influences)), influences, refined: None }
    }
}

/// Descends on the vertices with a texture of at most [`FITTED_SIZE`]. A cut-out's stay where they are: its outline is in its
/// texture.
fn fit(
    shared: &Shared<'_>,
    atlas: &Atlas,
    size: usize,
    shape: &Shape,
    influences: Vec<Influences>,
    number: u32,
    budget: u32,
) -> Result<Fitted, Error> {
    let Shared { model, settings, context, clock, .. } = *shared;
    let small = Canvas::new(shared, atlas, size.min(FITTED_SIZE));
    context.check(&model.name)?;
    context.report(StageId::Texture, Some(number as usize), 0.45);
    let textured = clock.time(StageId::Texture, || {
        let samples = small.bake(&shape.mesh, None);
        if is_cut_out(shape, &samples) {
            return None;
        }
        let initial = small.initial_texture(&samples, false);
        let low = LowPoly::new(&shape.mesh, atlas, shape.double_sided, initial);
        Some((low.with_motions(motions(shared, &influences)), small.texture_fit(&samples, false, None)))
    });
    context.check(&model.name)?;
    let Some((mut low, texture)) = textured else { return Ok(Fitted::unmoved(shared, atlas, shape, influences)) };
    context.report(StageId::Refine, Some(number as usize), 0.5);
    let (steps, coarse) = match begins_coarse(budget) {
        true => (settings.refine_steps, settings.coarse_steps),
        false => (settings.refine_steps / COARSE_MORE, 0.0),
    };
    let params = refine::RefineParams {
        steps,
        coarse,
        step_length: settings.step_length,
        texture,
        gradient_weight: settings.gradient_weight,
        laplacian_weight: settings.laplacian_weight,
        distance_weight: settings.distance_weight,
        normal_weight: settings.normal_weight,
    };
    let key = shared.content.map(|content| vertices_key(&content, settings, budget));
    let (positions, (influences, refined)) = clock.time(StageId::Refine, || {
        context.stored(key, || {
            let mut low = low.clone();
            let poses = shared.poses.filter(|_| settings.refine_weights);
            let mut skin = poses.map(|poses| Skin::new(poses, influences.clone()));
            let missing = shared.halves.is_none() && begins_coarse(budget);
            let own = missing.then(|| shared.view_renderer.halves(shared.views));
            let target = refine::ViewTarget {
                views: shared.views,
                half_resolution: shared.halves.or(own.as_deref()).unwrap_or_default(),
                bvh: shared.bvh,
                radius: shared.frame.radius,
                seed: shared.seed ^ u64::from(budget),
            };
            let refined = refine::refine(&mut low, skin.as_mut(), &target, &params, &context.cancellation);
            context.check(&model.name)?;
            let influences = skin.map_or_else(|| influences.clone(), Skin::into_influences);
            if let Some(key) = context.key(|| warm_start_key(&shape.mesh)) {
                context.leave(&key, &low.positions);
            }
            Ok((low.positions, (influences, refined)))
        })
    })?;
    low.positions = positions;
    let low = low.with_motions(motions(shared, &influences));
    Ok(Fitted { low, influences, refined: Some(refined) })
}

/// Whether the vertices of a level are moved at half size first.
pub(crate) fn begins_coarse(budget: u32) -> bool {
    budget <= COARSE_FACES
}

/// Splits the faces along the joint planes, if that comes last: their parts keep their place in the atlas.
fn split_at_joints(shared: &Shared<'_>, fitted: Fitted, atlas: Atlas, budget: u32) -> (Fitted, Atlas) {
    let JointPlanes { planes, split: done } = shared.planes;
    if *done || planes.is_empty() {
        return (fitted, atlas);
    }
    let Fitted { low, mut influences, refined } = fitted;
    let JointSplit { mesh, parts, .. } =
        skinning::split_along(shared.model, &low.mesh(), &influences, planes, budget as usize);
    influences.extend(self::influences(shared, &mesh).into_iter().skip(influences.len()));
    let uvs = parts.iter().map(|(face, places)| {
        let [a, b, c] = atlas.uvs[*face as usize];
        places.map(|place| a * place.x + b * place.y + c * place.z)
    });
    let uvs = uvs.collect();
    let chart = parts.iter().map(|(face, _)| atlas.chart[*face as usize]).collect();
    let atlas = Atlas { uvs, chart, ..atlas };
    let low = LowPoly::new(&mesh, &atlas, low.double_sided, low.texture).with_motions(motions(shared, &influences));
    (Fitted { low, influences, refined }, atlas)
}

impl<'a> Canvas<'a> {
    fn new(shared: &'a Shared<'a>, atlas: &'a Atlas, size: usize) -> Self {
        Self { shared, atlas, size, texels: TexelMap::new(atlas, size) }
    }

    fn bake(&self, mesh: &TriMesh, cards: Option<&Cards>) -> Vec<Option<SurfaceSample>> {
        let Shared { sampler, bvh, frame, context, .. } = *self.shared;
        let target = BakeTarget { mesh, atlas: self.atlas, texels: &self.texels, cards };
        Baker { sampler, bvh, bounding_sphere: frame }.bake(&target, &context.cancellation)
    }

    /// How the texture is to be fitted: not at all if what was baked has one colour. What lies behind a cut-out shows through
    /// it: its pixels say little about its own texture.
    fn texture_fit(&self, samples: &[Option<SurfaceSample>], alpha: bool, trust: Option<f32>) -> Option<TextureFit> {
        let settings = self.shared.settings;
        let baked = settings.initial_texture == InitialTexture::Baked;
        let wanted = settings.refine && !alpha && !(baked && is_uniform(samples));
        let descent = || TextureAdam { steps: settings.texture_steps, gradient_weight: settings.gradient_weight };
        let solver = match settings.texture_solver {
            TextureSolver::LeastSquares => Solver::LeastSquares,
            TextureSolver::Adam => Solver::Adam(descent()),
        };
        wanted.then_some(TextureFit { smoothness: settings.texture_smoothness, trust, solver })
    }

    /// Encoded colours with their gutters, and which texels a triangle covers.
    fn initial_texture(&self, samples: &[Option<SurfaceSample>], alpha: bool) -> TexelGrid {
        let size = self.size;
        let covered: Vec<bool> = samples.iter().map(Option::is_some).collect();
        if self.shared.settings.initial_texture == InitialTexture::Grey && !alpha {
            return TexelGrid { size, texels: vec![GREY; samples.len()], covered };
        }
        let encoded = |s: &SurfaceSample| s.color.truncate().map(linear_to_srgb).extend(1.0);
        let mut texels: Vec<Vec4> =
            samples.par_iter().with_min_len(4096).map(|s| s.as_ref().map_or(Vec4::ZERO, encoded)).collect();
        // Clear texels of a cut-out take the colour of their neighbours, which filtering mixes in.
        let known = |s: &Option<SurfaceSample>| s.as_ref().is_some_and(|s| !alpha || s.color.w >= 0.5);
        let known: Vec<bool> = samples.iter().map(known).collect();
        fill_unknown(&mut texels, &known, size);
        TexelGrid { size, texels, covered }
    }

    /// The texture at full size: baked anew on the final vertices, then fitted to the views.
    fn finish(&self, low: LowPoly, samples: &[Option<SurfaceSample>], alpha: bool) -> (LowPoly, Refined) {
        let mut low = low.retextured(self.atlas, self.initial_texture(samples, alpha));
        let fit = self.texture_fit(samples, alpha, Some(TRUST));
        let Shared { views, context, .. } = self.shared;
        let refined = refine::fit_texture(&mut low, views, fit.as_ref(), &context.cancellation);
        (low, refined)
    }
}

fn motions(shared: &Shared<'_>, influences: &[Influences]) -> Motions {
    shared.poses.map_or_else(Motions::default, |poses| poses.all_motions(influences))
}

fn influences(shared: &Shared<'_>, mesh: &TriMesh) -> Vec<Influences> {
    let method = match shared.settings.skin_transfer {
        SkinTransfer::ClosestSurface => Transfer::default(),
        SkinTransfer::NearestVertices => Transfer::NearestVertices { k: 4 },
    };
    let (mut influences, _) = skinning::transfer(shared.skin_source, mesh, &mesh.vertex_normals(), method);
    let faces = mesh.triangles.len();
    if let Some(bone_remap) = BoneRemap::of(shared.model, faces, shared.settings.bone_faces) {
        bone_remap.fold(&mut influences);
    }
    match shared.poses {
        Some(poses) if shared.settings.refine_weights && !shared.context.cancellation.is_cancelled() => {
            skinning::fit(shared.skin_source, poses, mesh, influences)
        }
        _ => influences,
    }
}

/// Levels of at most 1,000 faces are seen from afar: half the texture is enough.
fn texture_size(settings: &BakeSettings, budget: u32) -> u32 {
    if budget <= 1000 { (settings.texture_size / 2).max(64) } else { settings.texture_size }
}

/// Whether the level is a cut-out: it consists of the source's own triangles, and a good part of what they show is see-through.
fn is_cut_out(shape: &Shape, samples: &[Option<SurfaceSample>]) -> bool {
    if shape.candidate == Candidate::Cards {
        return true;
    }
    let clear = samples.iter().flatten().filter(|s| s.color.w < 0.5).count();
    shape.candidate == Candidate::Source && 20 * clear > samples.iter().flatten().count()
}

/// Whether every texel has the same base colour, to half a step of eight bits.
fn is_uniform(samples: &[Option<SurfaceSample>]) -> bool {
    let mut colors = samples.iter().flatten().map(|s| s.color);
    let first = colors.next().unwrap_or_default();
    colors.all(|c| (c - first).abs().max_element() < 0.5 / 255.0)
}
