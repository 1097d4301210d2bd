//! Typed parameters of every stage. Nothing behind this file reads settings: a stage is a function of its inputs and its
//! parameters, and the hash of the parameters is part of the key of its result.

use serde::Serialize;

use super::bars::GateParams;
use super::texture_sizes::{LevelView, TextureSizes};
use crate::data::{Reconstruction, TextureFormat};
use crate::gltf::ExportParams;
use crate::refine::{RefineParams, Solver, TextureAdam};
use crate::render::ViewParams;
use crate::settings::{
    BakeSettings, Candidates, ExistingLods, InitialTexture, JointSplitting, LaplacianOf, LevelMaterials, MorphTargets,
    Resolution, SkinTransfer, Target, TextureSolver,
};
use crate::simplify::{CandidateParams, CollapseParams, ImportanceParams};
use crate::skinning::{SkinningParams, Transfer};
use crate::unwrap::UnwrapParams;

/// Cells of the reconstructions that `Resolution::Auto` begins with.
const COARSE: u32 = 128;
const FINE: u32 = 256;
/// Side of the largest texture of a level that is only made to be compared.
const DRAFT_TEXTURE: u32 = 512;
/// Most faces of a level whose vertices are moved at half resolution: the edges of larger levels are only a few pixels long
/// there.
const HALF_RESOLUTION_FACES: u32 = 2000;
/// Such a level takes this many times the steps of a level that is refined at full resolution alone.
const HALF_RESOLUTION_STEPS: u32 = 3;
/// Number of nearest vertices in the paper's transfer of influences.
const NEAREST_VERTICES: usize = 4;

/// Parameters of a whole bake.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Params {
    /// Which files get levels.
    pub import: ImportParams,
    /// What each level must meet.
    pub targets: Vec<Target>,
    /// Views of the source.
    pub views: ViewParams,
    /// Candidates that compete.
    pub candidates: CandidateParams,
    /// Levels may keep the source's materials.
    pub keep_materials: bool,
    /// Weights of the source's triangles.
    pub importance: ImportanceParams,
    /// How candidates are collapsed.
    pub collapse: CollapseParams,
    /// Planes that faces are split along.
    pub joint_planes: JointPlaneParams,
    /// Influences.
    pub skinning: SkinningParams,
    /// Atlas of the levels with the largest textures.
    pub unwrap: UnwrapParams,
    /// How the sizes of the other textures follow.
    #[serde(skip_serializing_if = "TextureSizes::is_by_faces")]
    pub texture_sizes: TextureSizes,
    /// Initial texture, and how it is fitted.
    pub texture: TextureParams,
    /// Differentiable rendering.
    pub refine: RefinementParams,
    /// Texture set.
    pub maps: MapsParams,
    /// What is asked of the levels.
    pub gate: GateParams,
    /// The file.
    pub export: ExportParams,
}

/// Decides which files get levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ImportParams {
    /// If not, the file passes through.
    pub enabled: bool,
    /// A file with levels of its own passes through.
    pub keep_lods: bool,
}

/// Planes across the joints of the source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct JointPlaneParams {
    /// When faces are split.
    pub when: JointSplitting,
    /// Largest difference of the two largest weights of a vertex between two bones.
    pub delta: f32,
}

/// Initial texture, and how it is fitted to the views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TextureParams {
    /// The texture before it is fitted.
    pub initial: InitialTexture,
    /// Weight of the squared differences of neighbouring texels.
    pub smoothness: f32,
    /// The solver.
    pub solver: Solver,
    /// Radius of the circles of [`InitialTexture::Projected`], in texels; `None` for other initial textures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projection_radius: Option<u32>,
}

/// Differentiable rendering.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RefinementParams {
    /// If not, texture and vertices stay as they are.
    pub enabled: bool,
    /// Views at half resolution that vertices are moved by, besides the others.
    pub half_resolution_views: u32,
    /// Joint weights are moved together with the vertices.
    pub weights: bool,
    /// Steps and weights of the losses.
    pub vertices: RefineParams,
}

/// Texture set of a level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MapsParams {
    /// With a normal map.
    pub normal_map: bool,
    /// How colours are stored.
    pub format: TextureFormat,
    /// Morph targets are transferred.
    pub morphs: bool,
}

impl Params {
    /// The parameters that `settings` ask for.
    pub fn new(settings: &BakeSettings) -> Self {
        let texture_sizes = TextureSizes::new(settings);
        let faces = || settings.faces.iter().map(|&n| Target::Faces(n)).collect();
        Self {
            import: ImportParams { enabled: settings.enabled, keep_lods: settings.existing_lods == ExistingLods::Keep },
            targets: if settings.targets.is_empty() { faces() } else { settings.targets.clone() },
            views: ViewParams { count: settings.views, size: settings.view_size, poses: settings.poses },
            candidates: candidates(settings),
            keep_materials: settings.materials == LevelMaterials::Auto
                && settings.candidates != Candidates::Reconstruction
                && !settings.watertight
                && settings.bone_faces == 0.0,
            importance: ImportanceParams {
                materials: settings.importance.clone(),
                painted: settings.painted_importance,
            },
            collapse: CollapseParams {
                remove_invisible: settings.remove_invisible && !settings.watertight,
                visible_weight: f64::from(settings.visible_weight),
                curvature: f64::from(settings.curvature),
                curvature_angle: (settings.curvature > 0.0).then_some(f64::from(settings.curvature_angle)),
                invisible_rays: settings.invisible_rays,
                split_at_joints: settings.joint_planes == JointSplitting::BeforeUnwrap,
            },
            joint_planes: JointPlaneParams { when: settings.joint_planes, delta: settings.joint_delta },
            skinning: skinning(settings),
            unwrap: UnwrapParams { size: texture_sizes.largest(settings), gutter: settings.gutter },
            texture_sizes,
            texture: texture(settings),
            refine: refine(settings),
            maps: MapsParams {
                normal_map: settings.normal_map,
                format: settings.texture_format,
                morphs: settings.morph_targets == MorphTargets::Transfer,
            },
            gate: GateParams::new(settings),
            export: ExportParams { keep_source: settings.source.is_kept() },
        }
    }

    /// The parameters of a level that differ with its budget and its view.
    pub(crate) fn level(&self, budget: u32, view: LevelView) -> LevelParams {
        let size = self.texture_sizes.of_level(self.unwrap.size, budget, view);
        let vertices = self.refine.vertices;
        let vertices = match LevelParams::is_half_resolution(budget) {
            true => vertices,
            false => RefineParams { steps: vertices.steps / HALF_RESOLUTION_STEPS, coarse: 0.0, ..vertices },
        };
        LevelParams {
            unwrap: UnwrapParams { size, ..self.unwrap },
            skinning: self.skinning,
            texture: self.texture,
            refine: RefinementParams { vertices, ..self.refine },
        }
    }

    /// For levels that are made only to see which shape is better: without differentiable rendering and normal maps, with
    /// small textures.
    pub(crate) fn draft(&self) -> Self {
        let mut draft = self.unrefined();
        draft.unwrap.size = draft.unwrap.size.min(DRAFT_TEXTURE);
        draft.texture_sizes = TextureSizes::Faces;
        draft.maps = MapsParams { normal_map: false, format: TextureFormat::Png, ..draft.maps };
        draft
    }

    /// Without differentiable rendering, as a preview is made.
    pub(crate) fn unrefined(&self) -> Self {
        Self { refine: RefinementParams { enabled: false, ..self.refine }, ..self.clone() }
    }
}

/// Parameters of one level up to its refined vertices: exactly what is hashed into their key.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct LevelParams {
    pub(crate) unwrap: UnwrapParams,
    pub(crate) skinning: SkinningParams,
    pub(crate) texture: TextureParams,
    pub(crate) refine: RefinementParams,
}

impl LevelParams {
    /// The vertices of a level of this budget are moved at half resolution first.
    pub(crate) fn is_half_resolution(budget: u32) -> bool {
        budget <= HALF_RESOLUTION_FACES
    }
}

impl RefinementParams {
    /// Vertices are moved.
    pub(crate) fn moves_vertices(&self) -> bool {
        self.enabled && self.vertices.steps > 0
    }

    /// Some steps are taken at half resolution.
    pub(crate) fn has_half_resolution_steps(&self) -> bool {
        self.enabled && self.vertices.coarse * self.vertices.steps as f32 >= 1.0
    }
}

fn candidates(settings: &BakeSettings) -> CandidateParams {
    let finest = settings.finest_resolution;
    let reconstruction = match (settings.candidates, settings.resolution) {
        (Candidates::Source, _) => None,
        (_, Resolution::Auto) => Some(Reconstruction::new(finest.min(COARSE))),
        (_, Resolution::Cells(n)) => Some(Reconstruction::new(n)),
    };
    // Coarse suits small budgets, fine large ones.
    let further = |r| (settings.resolution == Resolution::Auto && reconstruction.is_some()).then_some(r);
    let beyond = |cells, r: Reconstruction| further(r).filter(|r| r.resolution > cells);
    CandidateParams {
        reconstruction,
        fine: beyond(COARSE, Reconstruction::new(finest.min(FINE))),
        thick: further(Reconstruction::thick(finest.min(COARSE))),
        finer: beyond(FINE, Reconstruction::new(finest)),
        // The source's own triangles need not be closed.
        source: settings.candidates != Candidates::Reconstruction && !settings.watertight,
        cards: settings.candidates == Candidates::All && !settings.watertight,
    }
}

fn skinning(settings: &BakeSettings) -> SkinningParams {
    SkinningParams {
        transfer: match settings.skin_transfer {
            SkinTransfer::ClosestSurface => Transfer::default(),
            SkinTransfer::NearestVertices => Transfer::NearestVertices { k: NEAREST_VERTICES },
        },
        bone_faces: settings.bone_faces,
        fit_weights: settings.refine_weights,
    }
}

fn texture(settings: &BakeSettings) -> TextureParams {
    let adam = TextureAdam {
        steps: settings.texture_steps,
        gradient_weight: settings.gradient_weight,
        perturbation: settings.texture_perturbation,
    };
    TextureParams {
        initial: settings.initial_texture,
        smoothness: settings.texture_smoothness,
        solver: match settings.texture_solver {
            TextureSolver::LeastSquares => Solver::LeastSquares,
            TextureSolver::Adam => Solver::Adam(adam),
        },
        projection_radius: (settings.initial_texture == InitialTexture::Projected)
            .then_some(settings.projection_radius),
    }
}

fn refine(settings: &BakeSettings) -> RefinementParams {
    RefinementParams {
        enabled: settings.refine,
        half_resolution_views: settings.coarse_views,
        weights: settings.refine_weights,
        vertices: RefineParams {
            steps: settings.refine_steps,
            coarse: settings.coarse_steps,
            step_length: settings.step_length,
            // The texture decides on its fit.
            texture: None,
            gradient_weight: settings.gradient_weight,
            laplacian_weight: settings.laplacian_weight,
            laplacian_of_positions: settings.laplacian_of == LaplacianOf::Positions,
            distance_weight: settings.distance_weight,
            normal_weight: settings.normal_weight,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_reconstruction_is_finer_than_wanted() {
        let cells = |finest_resolution: u32| {
            let params = candidates(&BakeSettings { finest_resolution, ..BakeSettings::default() });
            [params.reconstruction, params.fine, params.finer].map(|r| r.map(|r| r.resolution))
        };
        assert_eq!(cells(384), [Some(128), Some(256), Some(384)]);
        assert_eq!(cells(256), [Some(128), Some(256), None]);
        assert_eq!(cells(200), [Some(128), Some(200), None]);
        assert_eq!(cells(64), [Some(64), None, None]);
        let fixed = BakeSettings { resolution: Resolution::Cells(64), ..BakeSettings::default() };
        assert_eq!(candidates(&fixed).fine, None);
    }

    #[test]
    fn small_levels_have_half_the_texture_and_large_ones_a_third_of_the_steps() {
        let params = Params::new(&BakeSettings::default());
        let of = |budget| {
            let level = params.level(budget, LevelView::default());
            (level.unwrap.size, level.refine.vertices.steps, level.refine.has_half_resolution_steps())
        };
        assert_eq!([1000, 2000, 4000].map(of), [(512, 400, true), (1024, 400, true), (1024, 133, false)]);
        let cards = LevelView { has_cards: true, ..LevelView::default() };
        assert_eq!(params.level(1000, cards).unwrap.size, 1024);
    }

    #[test]
    fn every_setting_changes_a_parameter() {
        let base = Params::new(&BakeSettings::default());
        for (name, value) in [
            ("enabled", "false"),
            ("faces", "9"),
            ("targets", "ratio:0.5"),
            ("existing_lods", "replace"),
            ("source", "drop"),
            ("resolution", "64"),
            ("finest_resolution", "512"),
            ("candidates", "source"),
            ("remove_invisible", "false"),
            ("visible_weight", "0.5"),
            ("curvature", "1"),
            ("invisible_rays", "64"),
            ("importance", "a:2"),
            ("painted_importance", "2"),
            ("watertight", "true"),
            ("skin_transfer", "nearest-vertices"),
            ("bone_faces", "3"),
            ("morph_targets", "drop"),
            ("joint_planes", "before-unwrap"),
            ("joint_delta", "0.2"),
            ("poses", "7"),
            ("texture_size", "64"),
            ("texture_size", "auto"),
            ("texture_size", "64,1024"),
            ("texture_format", "jpeg-90"),
            ("gutter", "2"),
            ("normal_map", "false"),
            ("views", "9"),
            ("view_size", "256"),
            ("refine", "false"),
            ("refine_steps", "9"),
            ("coarse_steps", "0.5"),
            ("coarse_views", "9"),
            ("refine_weights", "false"),
            ("initial_texture", "grey"),
            ("initial_texture", "projected"),
            ("texture_solver", "adam"),
            ("texture_smoothness", "0.5"),
            ("gradient_weight", "0.1"),
            ("laplacian_weight", "0.5"),
            ("laplacian_of", "positions"),
            ("distance_weight", "0.5"),
            ("normal_weight", "0.5"),
            ("step_length", "0.05"),
            ("warn_below", "9"),
            ("min_psnr", "9"),
            ("min_silhouette_iou", "0.5"),
            ("max_deviation", "0.5"),
            ("on_miss", "fail"),
        ] {
            let mut overrides = crate::settings::BakeOverrides::default();
            overrides.set(name, value).expect(name);
            let layer = crate::settings::Layer { origin: crate::settings::Origin::CommandLine, overrides };
            let changed = crate::settings::resolve(vec![layer]).expect(name).settings;
            assert_ne!(Params::new(&changed), base, "{name}");
        }
    }
}
