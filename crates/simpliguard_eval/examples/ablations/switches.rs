//! The rows of the table: one part of the pipeline is switched off, or one of the paper's forms takes its place.

use simpliguard::settings::{
    BakeSettings, Candidates, InitialTexture, JointSplitting, LaplacianOf, SkinTransfer, TextureSolver,
};

/// A row.
pub(crate) struct Switch {
    /// The part of the pipeline; `--only` looks for it, too.
    pub(crate) part: &'static str,
    pub(crate) name: &'static str,
    /// The settings that make it.
    pub(crate) set: fn(BakeSettings) -> BakeSettings,
}

const fn row(part: &'static str, name: &'static str, set: fn(BakeSettings) -> BakeSettings) -> Switch {
    Switch { part, name, set }
}

/// The row that the others are compared with.
pub(crate) const ALL: Switch = row("all parts", "", |s| s);

pub(crate) const SWITCHES: [Switch; 35] = [
    row("shape", "without reconstruction", |s| BakeSettings { candidates: Candidates::Source, ..s }),
    row("shape", "with invisible faces", |s| BakeSettings { remove_invisible: false, ..s }),
    row("shape", "64 random rays on the final level in place of our test", |s| BakeSettings {
        remove_invisible: false,
        invisible_rays: 64,
        ..s
    }),
    row("shape", "64 random rays besides", |s| BakeSettings { invisible_rays: 64, ..s }),
    row("shape", "curvature 0.1, as printed", |s| BakeSettings { curvature: 0.1, ..s }),
    row("shape", "curvature 0.001, as printed", |s| curvature(s, 0.001, 0.001)),
    row("shape", "curvature 0.00001, as printed", |s| curvature(s, 0.000_01, 0.001)),
    row("shape", "curvature 0.001, half at 1", |s| curvature(s, 0.001, 1.0)),
    row("shape", "curvature 0.0001, half at 1", |s| curvature(s, 0.000_1, 1.0)),
    row("shape", "curvature 0.001, half at 10", |s| curvature(s, 0.001, 10.0)),
    row("texture", "grey at first", |s| initial(s, InitialTexture::Grey, 0)),
    row("texture", "cycle points at first", |s| initial(s, InitialTexture::Projected, 2)),
    row("texture", "baked, not fitted", |s| BakeSettings { refine: false, ..s }),
    row("texture", "single points, not fitted", |s| BakeSettings {
        refine: false,
        ..initial(s, InitialTexture::Projected, 0)
    }),
    row("texture", "cycle points of 1 texel, not fitted", |s| BakeSettings {
        refine: false,
        ..initial(s, InitialTexture::Projected, 1)
    }),
    row("texture", "cycle points of 2 texels, not fitted", |s| BakeSettings {
        refine: false,
        ..initial(s, InitialTexture::Projected, 2)
    }),
    row("texture", "no smoothness", |s| BakeSettings { texture_smoothness: 0.0, ..s }),
    row("texture", "Adam", adam),
    row("texture", "Adam, no image gradient", |s| BakeSettings { gradient_weight: 0.0, ..adam(s) }),
    row("texture", "Adam, no smoothness", |s| BakeSettings { texture_smoothness: 0.0, ..adam(s) }),
    row("texture", "Adam, perturbed by 0.5 texels", |s| BakeSettings { texture_perturbation: 0.5, ..adam(s) }),
    row("texture", "Adam, perturbed by 1 texel", |s| BakeSettings { texture_perturbation: 1.0, ..adam(s) }),
    row("texture", "Adam, perturbed by 2 texels", |s| BakeSettings { texture_perturbation: 2.0, ..adam(s) }),
    row("vertices", "none moved", |s| BakeSettings { refine_steps: 0, ..s }),
    row("vertices", "no image gradient", |s| BakeSettings { gradient_weight: 0.0, ..s }),
    row("vertices", "no distance to the source", |s| BakeSettings { distance_weight: 0.0, ..s }),
    row("vertices", "no Laplacian", |s| BakeSettings { laplacian_weight: 0.0, ..s }),
    row("vertices", "Laplacian of positions", |s| BakeSettings { laplacian_of: LaplacianOf::Positions, ..s }),
    row("vertices", "Laplacian of positions, a tenth", |s| BakeSettings {
        laplacian_of: LaplacianOf::Positions,
        laplacian_weight: s.laplacian_weight / 10.0,
        ..s
    }),
    row("vertices", "normal consistency 0.0001", |s| BakeSettings { normal_weight: 0.000_1, ..s }),
    row("vertices", "normal consistency 0.001", |s| BakeSettings { normal_weight: 0.001, ..s }),
    row("vertices", "normal consistency 0.01", |s| BakeSettings { normal_weight: 0.01, ..s }),
    row("motion", "weights of the nearest vertices", |s| BakeSettings {
        skin_transfer: SkinTransfer::NearestVertices,
        refine_weights: false,
        ..s
    }),
    row("motion", "joint planes at the end", |s| BakeSettings { joint_planes: JointSplitting::AfterRefine, ..s }),
    row("motion", "nearest vertices, joint planes at the end", |s| BakeSettings {
        skin_transfer: SkinTransfer::NearestVertices,
        refine_weights: false,
        joint_planes: JointSplitting::AfterRefine,
        ..s
    }),
];

fn curvature(s: BakeSettings, weight: f32, angle: f32) -> BakeSettings {
    BakeSettings { curvature: weight, curvature_angle: angle, ..s }
}

fn initial(s: BakeSettings, initial_texture: InitialTexture, projection_radius: u32) -> BakeSettings {
    BakeSettings { initial_texture, projection_radius, ..s }
}

fn adam(s: BakeSettings) -> BakeSettings {
    BakeSettings { texture_solver: TextureSolver::Adam, ..s }
}

impl Switch {
    /// The row's name with its part.
    pub(crate) fn label(&self) -> String {
        if self.name.is_empty() { self.part.to_owned() } else { format!("{}: {}", self.part, self.name) }
    }
}
