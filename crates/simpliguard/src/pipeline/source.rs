//! The imported source, prepared for the stages.

use std::sync::Arc;

use glam::Vec3;

use super::params::{JointPlaneParams, Params};
use super::runner::Runner;
use crate::animation::Poses;
use crate::data::{Cards, Influences, Model, Reconstruction, TriMesh};
use crate::geometry::{BoundingSphere, Bvh};
use crate::reconstruct::reconstruct;
use crate::render::{SurfaceSampler, View, ViewParams, ViewRenderer};
use crate::settings::JointSplitting;
use crate::simplify::{DeviationMetric, Importance, Inputs, OpaqueSurface, Tools};
use crate::skinning::{self, JointPlane, SkinSource, Transfer};
use crate::texture::{Baker, Texel};
use crate::{Cancellation, Error, Source, StageId, content_hash};

/// Structures over a model that borrow nothing but the model.
pub(crate) struct SourceIndex<'a> {
    /// One layer of the source.
    pub(crate) model: &'a Model,
    /// The whole source.
    pub(crate) whole: &'a Model,
    pub(crate) sampler: SurfaceSampler<'a>,
    pub(crate) sphere: BoundingSphere,
    pub(crate) poses: Option<Poses<'a>>,
    pub(crate) bvh: Arc<Bvh>,
    pub(crate) opaque: OpaqueSurface,
    /// Seed of everything that is random, from the bytes of the file.
    pub(crate) seed: u64,
}

impl<'a> SourceIndex<'a> {
    /// Builds the structures for one layer of the whole source.
    pub(crate) fn new(
        source: &Source<'_>,
        (whole, model): (&'a Model, &'a Model),
        params: &ViewParams,
        run: &Runner<'_>,
    ) -> Result<Self, Error> {
        let (surface, sampler) = (&model.surface, SurfaceSampler::new(model));
        let (poses, most) = (params.poses as usize, ViewParams::posed(params.count));
        let poses = run.time(StageId::Views, || Poses::of(model, poses, most, run.cancellation()));
        run.check()?;
        let (bvh, opaque) = run.time(StageId::Simplify, || {
            let bvh = Arc::new(Bvh::new(&surface.positions, &surface.triangles));
            let opaque = OpaqueSurface::of(&sampler, &bvh);
            (bvh, opaque)
        });
        let hash = content_hash(source.bytes);
        let seed = hash.as_bytes()[..8].iter().fold(0u64, |seed, &byte| seed << 8 | u64::from(byte));
        Ok(Self { model, whole, sphere: BoundingSphere::around(&surface.positions), sampler, poses, bvh, opaque, seed })
    }

    /// Samples the source for the texels of a level.
    pub(crate) fn baker(&self) -> Baker<'_> {
        Baker { sampler: &self.sampler, bvh: &self.bvh, bounding_sphere: self.sphere }
    }

    /// Renders views of the source.
    pub(crate) fn view_renderer<'s>(&'s self, params: ViewParams, cancellation: &'s Cancellation) -> ViewRenderer<'s> {
        let Self { sampler, sphere, poses, seed, .. } = self;
        ViewRenderer { sampler, sphere: *sphere, poses: poses.as_ref(), params, seed: *seed, cancellation }
    }
}

/// A source as the stages read it.
pub(crate) struct PreparedSource<'a> {
    pub(crate) index: &'a SourceIndex<'a>,
    pub(crate) skin_source: SkinSource<'a>,
    pub(crate) joint_planes: Vec<JointPlane>,
    pub(crate) importance: Option<Importance>,
    pub(crate) deviation_metric: DeviationMetric<'a>,
}

impl<'a> PreparedSource<'a> {
    /// Prepares a source for the stages.
    ///
    /// # Errors
    /// If a glob of the importance is malformed.
    pub(crate) fn new(index: &'a SourceIndex<'a>, params: &Params, run: &Runner<'_>) -> Result<Self, Error> {
        Ok(Self {
            index,
            skin_source: SkinSource::new(index.model, &index.bvh),
            joint_planes: joint_planes(index.model, &params.joint_planes),
            importance: Importance::of(index.model, &params.importance)?,
            deviation_metric: run.time(StageId::Simplify, || DeviationMetric::new(&index.opaque, run.cancellation())),
        })
    }
}

fn joint_planes(model: &Model, params: &JointPlaneParams) -> Vec<JointPlane> {
    match params.when {
        JointSplitting::Off => Vec::new(),
        JointSplitting::BeforeUnwrap | JointSplitting::AfterRefine => skinning::joint_planes(model, params.delta),
    }
}

/// The stages that candidates need.
pub(crate) struct StageTools<'a> {
    pub(crate) source: &'a PreparedSource<'a>,
    pub(crate) run: &'a Runner<'a>,
}

impl<'a> StageTools<'a> {
    /// The inputs of `simplify`, with these tools and `views` of the source.
    pub(crate) fn inputs(&'a self, views: &'a [View]) -> Inputs<'a> {
        let Self { source, run } = self;
        let index = source.index;
        Inputs {
            model: index.model,
            bvh: &index.bvh,
            components: source.skin_source.components(),
            opaque: &index.opaque,
            deviation_metric: &source.deviation_metric,
            sphere: index.sphere,
            views,
            poses: index.poses.as_ref(),
            importance: source.importance.as_ref(),
            tools: self,
            cancellation: run.cancellation(),
        }
    }
}

impl Tools for StageTools<'_> {
    fn reconstruct(&self, mesh: &TriMesh, bvh: &Bvh, free: &[Vec3], params: &Reconstruction) -> TriMesh {
        let cancellation = self.run.cancellation();
        let work = || reconstruct(mesh, bvh, free, params, cancellation);
        self.run.time(StageId::Reconstruct, work)
    }

    fn influences(&self, mesh: &TriMesh) -> Vec<Influences> {
        skinning::transfer(&self.source.skin_source, mesh, &mesh.vertex_normals(), Transfer::default()).0
    }

    fn has_joint_planes(&self) -> bool {
        !self.source.joint_planes.is_empty()
    }

    fn split_at_joints(&self, mesh: &TriMesh, most: usize) -> TriMesh {
        let PreparedSource { index, joint_planes, .. } = self.source;
        skinning::split_along(index.model, mesh, &self.influences(mesh), joint_planes, most).mesh
    }

    fn shown(&self, mesh: &TriMesh, cards: Option<&Cards>, points: &[(u32, Vec3)], areas: &[f32]) -> Vec<bool> {
        let texel = |&(triangle, barycentric): &(u32, Vec3)| Texel { triangle, barycentric };
        self.source.index.baker().shown(mesh, cards, &points.iter().map(texel).collect::<Vec<_>>(), areas)
    }
}
