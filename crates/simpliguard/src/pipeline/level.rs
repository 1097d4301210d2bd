//! From a shape to a finished level: unwrap, skinning, texture, refine, maps.

use std::iter;

use glam::Vec3;
use rayon::prelude::*;

use super::level_task::{LevelTask, Levels, charted, level_view, may_move};
use super::level_texture::LevelTexture;
use super::level_whole::{Finished, WholeLevel};
use super::params::LevelParams;
use super::report::LevelReport;
use super::runner::Runner;
use super::store::{atlas_key, choice_key, vertices_key, warm_start_key};
use crate::animation::Motions;
use crate::data::{Atlas, Candidate, Influences, Level, TriMesh};
use crate::geometry::Topology;
use crate::refine::{self, Backend, Cpu, LowPoly, RefineParams, Refined, Skin, TexelGrid, TextureFit, ViewTarget};
use crate::render::SurfaceSample;
use crate::settings::JointSplitting;
use crate::simplify::{self, Selected, Shape};
use crate::skinning;
use crate::unwrap::unwrap;
use crate::{Error, StageId};

/// Largest texture while vertices are moved: a view resolves no more, and the final texture has the full size.
const FITTED_SIZE: usize = 512;
/// Difference of colours at which a pixel counts half in the final texture.
const TRUST: f32 = 0.3;
/// Relative score of a runner-up that may turn out better.
const CLOSE_SCORE: f64 = 2.0;
/// Difference in dB from which on an unrefined level of the runner-up is clearly better than that of the best shape.
const CLEARLY_BETTER: f32 = 0.5;
/// The same from which on it is clearly worse.
const CLEARLY_WORSE: f32 = 0.3;
/// PSNR in dB with the vertices as given from which on they may be better left there. The views that move them are antialiased
/// in another way than those of the level: beyond this, some steps fit that difference.
const NEAR: f32 = 40.0;
/// Gain of moved vertices in dB that no other way of antialiasing takes away.
const SURE_GAIN: f32 = 0.55;
/// Difference in dB from which on a level looks less like its source than another.
const LESS_LIKE: f32 = 0.1;

impl Levels<'_> {
    /// Makes the levels side by side, and a report of each.
    pub(super) fn make(&self) -> Result<(Vec<Level>, Vec<LevelReport>), Error> {
        let levels = &self.shapes.solid.levels;
        self.run.expect_levels(levels.len());
        let make = |i: usize| {
            let choice = self.choose(i)?;
            Ok((choice.is_none(), self.task(i, choice.unwrap_or(Choice::Best), self.run).make()?))
        };
        let made: Result<Vec<_>, Error> = (0..levels.len()).into_par_iter().map(make).collect();
        let (are_open, mut made): (Vec<bool>, Vec<_>) = made?.into_iter().unzip();
        for (i, is_open) in are_open.into_iter().enumerate() {
            self.reconsider((i, is_open), &mut made)?;
        }
        Ok(made.into_iter().unzip())
    }

    /// The shape of a level. Scores are estimates: where two of them are close, both shapes get a texture, and the pictures
    /// decide. `None` where they are close, too.
    fn choose(&self, i: usize) -> Result<Option<Choice>, Error> {
        let (budget, selected) = &self.shapes.solid.levels[i];
        if !is_close(selected) || self.pictures.is_none() {
            return Ok(Some(Choice::Best));
        }
        let (params, trial) = (self.params.draft(), self.run.trial());
        let key = self.shapes.solid.key.map(|shapes| choice_key(&shapes, &params, *budget));
        let is_runner_up = self.run.get_or_put(key, || {
            let draft = Levels { params: &params, run: &trial, ..*self };
            let reached = |choice| draft.task(i, choice, &trial).make().map(|made| psnr(&made));
            let (best, runner_up) = rayon::join(|| reached(Choice::Best), || reached(Choice::RunnerUp));
            let gain = runner_up? - best?;
            let is_clear = !(-CLEARLY_WORSE..=CLEARLY_BETTER).contains(&gain);
            Ok(is_clear.then_some(gain > 0.0))
        })?;
        Ok(is_runner_up.map(Choice::of))
    }

    /// A level with an open choice is made again from the other shape, as is one that hardly looks like its source, or less so
    /// than a smaller level does. The better of the two stays.
    fn reconsider(&self, (i, is_open): (usize, bool), made: &mut [(Level, LevelReport)]) -> Result<(), Error> {
        let Selected { best, runner_up } = &self.shapes.solid.levels[i].1;
        if runner_up.is_none() || self.pictures.is_none() {
            return Ok(());
        }
        let (reached, smaller) = (psnr(&made[i]), made[..i].iter().map(psnr).fold(f32::NEG_INFINITY, f32::max));
        if !is_open && made[i].1.warning.is_none() && reached + LESS_LIKE >= smaller {
            return Ok(());
        }
        let other = if made[i].1.candidate == best.candidate.to_string() { Choice::RunnerUp } else { Choice::Best };
        let again = self.task(i, other, &self.run.silent()).make()?;
        if psnr(&again) > reached {
            made[i] = again;
        }
        Ok(())
    }

    /// The task of the level with index `i`.
    fn task<'s>(&'s self, i: usize, choice: Choice, run: &Runner<'s>) -> LevelTask<'s> {
        let (budget, selected) = &self.shapes.solid.levels[i];
        let (shape, is_runner_up) = choice.shape(selected);
        let extra = self.shapes.extra.of(*budget).map(|(_, shape)| shape);
        let view = level_view(self.first + i, (shape, extra), self.source.deviation_metric.diagonal());
        let (params, number) = (self.params.level(*budget, view), self.first + i + 1);
        LevelTask { all: *self, number, budget: *budget, shape, is_runner_up, params, run: run.level(number) }
    }
}

/// Which of the selected shapes a level is made from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Choice {
    Best,
    RunnerUp,
}

impl Choice {
    pub(super) fn of(is_runner_up: bool) -> Self {
        if is_runner_up { Self::RunnerUp } else { Self::Best }
    }

    /// The shape, and if it is the runner-up. Without a runner-up, the best one.
    pub(super) fn shape(self, selected: &Selected) -> (&Shape, bool) {
        let runner_up = selected.runner_up.as_ref().filter(|_| self == Self::RunnerUp);
        (runner_up.map_or(&selected.best, |runner_up| &runner_up.shape), runner_up.is_some())
    }
}

/// The scores of both shapes are close, so that pictures decide.
pub(super) fn is_close(selected: &Selected) -> bool {
    selected.runner_up.as_ref().is_some_and(|runner_up| runner_up.relative_score < CLOSE_SCORE)
}

/// How much a level that was made looks like its source, in dB.
fn psnr((_, report): &(Level, LevelReport)) -> f32 {
    report.mean_psnr()
}

/// A level's mesh with its initial texture, and how the texture is fitted.
struct Textured {
    low: LowPoly,
    fit: Option<TextureFit>,
}

/// A level's mesh with its final vertices.
struct Vertices {
    low: LowPoly,
    influences: Vec<Influences>,
    /// Gain of the refinement; `None` if the vertices were not moved.
    refined: Option<Refined>,
    /// The GPU that moved them; `None` for the CPU.
    device: Option<String>,
}

impl LevelTask<'_> {
    fn make(&self) -> Result<(Level, LevelReport), Error> {
        let (atlas, extra_atlas) = self.unwrap()?;
        let influences = self.skin()?;
        self.run.validate(StageId::Skinning, || influences.iter().try_for_each(Influences::validate));
        let Some(textured) = self.initial_texture(&atlas, &influences)? else {
            return self.complete(self.unmoved(&atlas, influences), atlas, &extra_atlas);
        };
        let vertices = self.refine(textured, influences)?;
        let still = self.may_be_better_unmoved(&vertices).then(|| self.unmoved(&atlas, vertices.influences.clone()));
        let moved = self.complete(vertices, atlas.clone(), &extra_atlas)?;
        let Some(still) = still else { return Ok(moved) };
        let still = self.complete(still, atlas, &extra_atlas)?;
        Ok(if psnr(&still) > psnr(&moved) { still } else { moved })
    }

    /// The vertices were moved although the level looked much like its source before.
    fn may_be_better_unmoved(&self, Vertices { low, refined, .. }: &Vertices) -> bool {
        let is_doubtful =
            |refined: Refined| refined.psnr_texture >= NEAR && refined.psnr < refined.psnr_texture + SURE_GAIN;
        refined.is_some_and(is_doubtful) && self.all.pictures.is_some() && low.positions != self.shape.mesh.positions
    }

    /// The level and its report, once its vertices are final.
    fn complete(&self, vertices: Vertices, atlas: Atlas, extra_atlas: &Atlas) -> Result<(Level, LevelReport), Error> {
        self.run.validate(StageId::Refine, || Topology::validate_manifold(&vertices.low.mesh()));
        let (vertices, atlas) = self.split_at_joints(vertices, atlas);
        let (level, report) = self.finish(vertices, &atlas, extra_atlas)?;
        self.run.validate(StageId::Maps, || level.validate());
        Ok((level, report))
    }

    /// Charts and texture coordinates, denser where more is seen: those of the solid layer, and those of the others.
    fn unwrap(&self) -> Result<(Atlas, Atlas), Error> {
        let Self { shape, run, .. } = self;
        let (params, cancellation) = (&self.params.unwrap, run.cancellation());
        let atlas = run.run(StageId::Unwrap, || {
            let solid = (&shape.mesh, &self.all.source.index.sphere, shape.double_sided);
            let extra = self.extra().map(|(layer, e)| (&e.mesh, &layer.source.index.sphere, e.double_sided));
            let (mesh, densities) = charted(iter::once(solid).chain(extra), cancellation);
            let key = run.key(|| atlas_key(&mesh, &densities, params));
            let atlas = run.get_or_put(key, || Ok(unwrap(&mesh, Some(&densities), params, cancellation)))?;
            run.validate(StageId::Unwrap, || atlas.validate(mesh.triangles.len()));
            Ok(atlas)
        })??;
        let (solid, all) = (shape.mesh.triangles.len(), atlas.uvs.len());
        Ok((atlas.part(0..solid), atlas.part(solid..all)))
    }

    fn skin(&self) -> Result<Vec<Influences>, Error> {
        self.run.run(StageId::Skinning, || self.influences(&self.shape.mesh))
    }

    fn influences(&self, mesh: &TriMesh) -> Vec<Influences> {
        let poses = self.all.source.index.poses.as_ref().filter(|_| !self.run.cancellation().is_cancelled());
        skinning::skin(&self.all.source.skin_source, poses, mesh, &self.params.skinning)
    }

    fn motions(&self, influences: &[Influences]) -> Motions {
        let poses = self.all.source.index.poses.as_ref();
        poses.map_or_else(Motions::default, |poses| poses.all_motions(influences))
    }

    /// The initial texture that vertices are moved with. `None` if they stay where they are: cut-outs and cards have their
    /// outline in the texture.
    fn initial_texture(&self, atlas: &Atlas, influences: &[Influences]) -> Result<Option<Textured>, Error> {
        let Self { shape, run, .. } = self;
        if !may_move(shape, &self.params) {
            return Ok(None);
        }
        run.run(StageId::Texture, || {
            let texture = self.texture(atlas, (self.params.unwrap.size as usize).min(FITTED_SIZE));
            let samples = texture.bake(&shape.mesh, None, run.cancellation());
            if is_cut_out(shape, &samples) {
                return None;
            }
            let low = LowPoly::new(&shape.mesh, atlas, shape.double_sided, texture.initial(&samples, false));
            Some(Textured { low: low.with_motions(self.motions(influences)), fit: texture.fit(&samples, None) })
        })
    }

    fn texture<'s>(&'s self, atlas: &'s Atlas, size: usize) -> LevelTexture<'s> {
        LevelTexture::new(self.all.source, &self.all.views.full, atlas, self.params.texture, size)
    }

    /// Moves the vertices by differentiable rendering, and the joint weights with them.
    fn refine(&self, textured: Textured, influences: Vec<Influences>) -> Result<Vertices, Error> {
        let Textured { mut low, fit } = textured;
        let key =
            self.all.shapes.solid.key.map(|shapes| vertices_key(&shapes, &self.params, self.budget, self.is_runner_up));
        let (positions, (influences, (refined, device))) = self.run.stored(StageId::Refine, key, || {
            let moved = self.move_vertices(&low, fit, influences);
            if let Some(key) = self.run.key(|| warm_start_key(&self.shape.mesh)) {
                self.run.put(&key, &moved.low.positions);
            }
            Ok((moved.low.positions, (moved.influences, (moved.refined.unwrap_or_default(), moved.device))))
        })?;
        low.positions = positions;
        let low = low.with_motions(self.motions(&influences));
        Ok(Vertices { low, influences, refined: Some(refined), device })
    }

    fn move_vertices(&self, low: &LowPoly, fit: Option<TextureFit>, influences: Vec<Influences>) -> Vertices {
        let (index, refine) = (self.all.source.index, &self.params.refine);
        // Views that nobody expected to be needed: an object of the store was lost meanwhile.
        let is_missing = self.all.views.half_resolution.is_none()
            && LevelParams::is_half_resolution(self.budget)
            && refine.has_half_resolution_steps();
        let own = is_missing.then(|| self.all.views.render_half_resolution(self.all.params, &self.run));
        let target = ViewTarget {
            views: &self.all.views.full,
            half_resolution: self.all.views.half_resolution.as_deref().or(own.as_deref()).unwrap_or_default(),
            bvh: &index.bvh,
            radius: index.sphere.radius,
            seed: index.seed ^ u64::from(self.budget),
        };
        let params = RefineParams { texture: fit, ..refine.vertices };
        // A device that fails leaves the whole level to the CPU, from its start.
        let on_device = self.run.device(target.views, low.texture.size).and_then(|device| {
            let vertices = self.move_vertices_on(device, (low, &influences), &target, &params);
            vertices.inspect_err(|error| self.run.give_up_device(device, error)).ok()
        });
        on_device.unwrap_or_else(|| {
            let Ok(vertices) = self.move_vertices_on(&Cpu, (low, &influences), &target, &params);
            Vertices { device: None, ..vertices }
        })
    }

    fn move_vertices_on<E>(
        &self,
        backend: &dyn Backend<Error = E>,
        (low, influences): (&LowPoly, &[Influences]),
        target: &ViewTarget<'_>,
        params: &RefineParams,
    ) -> Result<Vertices, E> {
        let poses = self.all.source.index.poses.as_ref().filter(|_| self.params.refine.weights);
        let (mut low, mut skin) = (low.clone(), poses.map(|poses| Skin::new(poses, influences.to_vec())));
        let cancellation = self.run.cancellation();
        let refined = refine::refine((&mut low, skin.as_mut()), target, params, backend, cancellation)?;
        let influences = skin.map_or_else(|| influences.to_vec(), Skin::into_influences);
        Ok(Vertices { low, influences, refined: Some(refined), device: Some(backend.name().to_owned()) })
    }

    /// The shape as it is, without a texture. The vertices of a preview lie where an earlier bake has left them.
    fn unmoved(&self, atlas: &Atlas, influences: Vec<Influences>) -> Vertices {
        let mesh = &self.shape.mesh;
        let mut low = LowPoly::new(mesh, atlas, self.shape.double_sided, TexelGrid::empty());
        let moved: Option<Vec<Vec3>> = self.all.warm_start.then(|| self.run.get(&warm_start_key(mesh))).flatten();
        if let Some(positions) = moved.filter(|positions| positions.len() == low.positions.len()) {
            low.positions = positions;
        }
        Vertices { low: low.with_motions(self.motions(&influences)), influences, refined: None, device: None }
    }

    /// Splits the faces along the joint planes, if that comes last: the new faces keep their place in the atlas.
    fn split_at_joints(&self, vertices: Vertices, atlas: Atlas) -> (Vertices, Atlas) {
        let planes = &self.all.source.joint_planes;
        let is_last = self.all.params.joint_planes.when == JointSplitting::AfterRefine;
        if !is_last || planes.is_empty() || self.shape.cards.is_some() || self.shape.mesh.triangles.is_empty() {
            return (vertices, atlas);
        }
        let Vertices { low, mut influences, refined, device } = vertices;
        let model = self.all.source.index.model;
        let split = skinning::split_along(model, &low.mesh(), &influences, planes, self.budget as usize);
        influences.extend(self.influences(&split.mesh).into_iter().skip(influences.len()));
        let uvs = split.origins.iter().map(|(face, places)| {
            let [a, b, c] = atlas.uvs[*face as usize];
            places.map(|place| a * place.x + b * place.y + c * place.z)
        });
        let uvs = uvs.collect();
        let chart = split.origins.iter().map(|(face, _)| atlas.chart[*face as usize]).collect();
        let atlas = Atlas { uvs, chart, ..atlas };
        let low = LowPoly::new(&split.mesh, &atlas, low.double_sided, low.texture);
        let low = low.with_motions(self.motions(&influences));
        (Vertices { low, influences, refined, device }, atlas)
    }

    /// The level and its report, once its vertices are final.
    fn finish(&self, vertices: Vertices, atlas: &Atlas, extra_atlas: &Atlas) -> Result<(Level, LevelReport), Error> {
        self.run.run(StageId::Maps, || {
            let texture = self.texture(atlas, self.params.unwrap.size as usize);
            let finished = self.final_texture(vertices, atlas, &texture)?;
            let mut whole = WholeLevel::of_solid(self, finished, atlas, texture.texels);
            whole.add_extra_layers(self, extra_atlas);
            self.run.check()?;
            Ok(whole.finish(self))
        })?
    }

    /// Bakes the texture anew on the final vertices, and fits it to the views if the level is refined.
    fn final_texture(&self, vertices: Vertices, atlas: &Atlas, texture: &LevelTexture<'_>) -> Result<Finished, Error> {
        let Vertices { mut low, influences, refined, device } = vertices;
        let cancellation = self.run.cancellation();
        let mut samples = texture.bake(&low.mesh(), self.shape.cards.as_ref(), cancellation);
        self.run.check()?;
        let cut_out = refined.is_none() && is_cut_out(self.shape, &samples);
        low.double_sided |= cut_out;
        let mut low = low.retextured(atlas, texture.initial(&samples, cut_out));
        if !self.params.refine.enabled {
            return Ok(Finished { low, influences, samples, cut_out, refined, device });
        }
        refine::fit_opacity(&mut low, &self.all.views.aliased, cancellation);
        let opacities = samples.iter_mut().zip(&low.texture.opacity);
        opacities.for_each(|(sample, opacity)| sample.iter_mut().for_each(|sample| sample.color.w = *opacity));
        let (fitted, fitted_by) = self.fit_texture(&mut low, texture.fit(&samples, Some(TRUST)).as_ref());
        self.run.check()?;
        let refined = Some(Refined { psnr: fitted.psnr, ..refined.unwrap_or(fitted) });
        Ok(Finished { low, influences, samples, cut_out, refined, device: device.or(fitted_by) })
    }

    /// Fits the final texture. Returns the gain, and the device that has fitted it.
    fn fit_texture(&self, low: &mut LowPoly, fit: Option<&TextureFit>) -> (Refined, Option<String>) {
        let (views, cancellation) = (&self.all.views.aliased, self.run.cancellation());
        let device = self.run.device(views, low.texture.size).filter(|_| low.texture.opacity.is_empty());
        let on_device = device.and_then(|device| {
            let mut fitted = low.clone();
            let refined = refine::fit_texture(&mut fitted, views, fit, device, cancellation);
            let refined = refined.inspect_err(|error| self.run.give_up_device(device, error)).ok()?;
            low.texture = fitted.texture;
            Some((refined, Some(device.name().to_owned())))
        });
        on_device.unwrap_or_else(|| {
            let Ok(refined) = refine::fit_texture(low, views, fit, &Cpu, cancellation);
            (refined, None)
        })
    }
}

/// The level is a cut-out: it consists of the source's own triangles, and a good fraction of its texels is clear.
fn is_cut_out(shape: &Shape, samples: &[Option<SurfaceSample>]) -> bool {
    if shape.candidate == Candidate::Cards {
        return true;
    }
    let clear = samples.iter().flatten().filter(|s| s.color.w < 0.5).count();
    shape.candidate == Candidate::Source && simplify::is_cut_out(clear, samples.iter().flatten().count())
}
