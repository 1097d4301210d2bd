//! The enums that fields can have as values.

use serde::{Deserialize, Serialize};

use super::value::{Limit, Value, choice};
use crate::data::TextureFormat;

choice! {
    /// The time that a bake may take. It supplies the values of fields that no layer sets.
    pub enum Quality {
        /// For a first look: few views, no refinement.
        Draft,
        /// For the game.
        #[default]
        Standard,
        /// For a release.
        Best,
    }
}

choice! {
    /// The things of a file that get levels.
    pub enum Scope {
        /// The whole default scene: each level is one mesh.
        #[default]
        Scene,
        /// Each object on its own.
        Objects,
    }
}

choice! {
    /// What happens to a level that misses one of its bars.
    pub enum OnMiss {
        /// The report, the log and the overlay say so.
        #[default]
        Warn,
        /// It is made again with more faces.
        RaiseBudget,
        /// The bake fails: the model stays as it is.
        Fail,
    }
}

choice! {
    /// The treatment of a file that already has levels of detail.
    pub enum ExistingLods {
        /// The file passes through unchanged. With `scope: Objects`, each object keeps its levels and gets smaller ones.
        #[default]
        Keep,
        /// Its own levels are dropped, and new ones are made from the finest.
        Replace,
    }
}

choice! {
    /// The treatment of the source's own geometry in the output.
    pub enum SourceGeometry {
        /// The source comes first, unchanged.
        #[default]
        Keep,
        /// The meshes and textures of the source are left out; its nodes and clips stay.
        Drop,
        /// A game that imports its models loads the meshes and textures of the source, and of all levels but the smallest,
        /// when somebody comes near. Where the command bakes, the source comes first, as with `Keep`.
        OnDemand,
    }
}

impl SourceGeometry {
    /// True if a baked file has the source.
    pub fn is_kept(self) -> bool {
        self != Self::Drop
    }
}

choice! {
    /// The form of textures in a file with levels.
    pub enum TextureCompression {
        /// That of the program: blocks where a game imports its models, images where the command bakes.
        #[default]
        Auto,
        /// PNG and JPEG.
        Off,
        /// Blocks of BC7.
        Bc,
    }
}

impl TextureCompression {
    /// The form in a file that a game imports for itself.
    #[must_use]
    pub fn in_game(self) -> Self {
        if self == Self::Auto { Self::Bc } else { self }
    }
}

choice! {
    /// The surfaces that compete for each level.
    pub enum Candidates {
        /// All; the one that renders most like the source wins.
        #[default]
        All,
        /// Only the watertight reconstruction.
        Reconstruction,
        /// Only the source's own welded mesh.
        Source,
    }
}

choice! {
    /// The materials of a level.
    pub enum LevelMaterials {
        /// Those of the source, where the level then looks clearly more like it and the source stays in the file; else one that
        /// is baked.
        #[default]
        Auto,
        /// One material with an atlas of its own, baked from the source.
        Baked,
    }
}

choice! {
    /// The source of the joint weights of a level.
    pub enum SkinTransfer {
        /// From the closest point of the source's surface.
        #[default]
        ClosestSurface,
        /// From the nearest vertices of the source, weighted by distance.
        NearestVertices,
    }
}

choice! {
    /// The treatment of the source's morph targets.
    pub enum MorphTargets {
        /// The levels have them too, and clips morph them like the source.
        #[default]
        Transfer,
        /// The levels keep the shape of the default weights.
        Drop,
    }
}

choice! {
    /// The moment at which faces are split along the planes where limbs bend.
    pub enum JointSplitting {
        /// Never.
        #[default]
        Off,
        /// Before texture coordinates are made, so that refinement fits the new vertices too.
        BeforeUnwrap,
        /// At the end, as in the paper: the texture does not change.
        AfterRefine,
    }
}

choice! {
    /// The texture before it is fitted to the views.
    pub enum InitialTexture {
        /// Baked from the source along the level's normals.
        #[default]
        Baked,
        /// A uniform grey.
        Grey,
        /// Copied from the source's texture, pixel by pixel of the views, as in the paper (section 3.3).
        Projected,
    }
}

choice! {
    /// The solver that fits textures to the views.
    pub enum TextureSolver {
        /// The exact minimum of the squared error, by conjugate gradients.
        #[default]
        LeastSquares,
        /// `texture_steps` steps of the optimizer Adam, as in the paper.
        Adam,
    }
}

choice! {
    /// The vectors whose Laplacian is kept small.
    pub enum LaplacianOf {
        /// The displacements of the vertices: corners of the shape stay.
        #[default]
        Displacements,
        /// The positions of the vertices, as in the paper: it smooths the shape.
        Positions,
    }
}

/// Resolution of the reconstruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Resolution {
    /// Chosen by the candidates of each level.
    #[default]
    Auto,
    /// Cells along the longest side of the model's bounding box.
    Cells(u32),
}

impl Value for Resolution {
    fn accepts(limit: Limit) -> String {
        format!("Auto or Cells(n), n{}", limit.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        match text.trim() {
            "auto" => Ok(Self::Auto),
            text => text.parse().map(Self::Cells).map_err(|_| "auto or a number of cells".into()),
        }
    }

    fn ron(&self) -> String {
        match self {
            Self::Auto => "Auto".into(),
            Self::Cells(n) => format!("Cells({n})"),
        }
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        match self {
            Self::Cells(n) if !limit.allows_whole(*n) => Err(Self::accepts(limit)),
            _ => Ok(()),
        }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        match self {
            Self::Cells(n) => n.nearest(limit).map(Self::Cells),
            Self::Auto => None,
        }
    }
}

impl Value for TextureFormat {
    fn accepts(limit: Limit) -> String {
        format!("Png or Jpeg(n), n{}", limit.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        let quality = |text: &str| text.strip_prefix("jpeg-").and_then(|n| n.parse().ok());
        match text.trim() {
            "png" => Ok(Self::Png),
            text => quality(text).map(Self::Jpeg).ok_or_else(|| "png or jpeg-n, such as jpeg-90".into()),
        }
    }

    fn ron(&self) -> String {
        match self {
            Self::Png => "Png".into(),
            Self::Jpeg(n) => format!("Jpeg({n})"),
        }
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        match self {
            Self::Jpeg(n) if !limit.allows_whole(*n) => Err(Self::accepts(limit)),
            _ => Ok(()),
        }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        match self {
            Self::Jpeg(n) => n.nearest(limit).map(Self::Jpeg),
            Self::Png => None,
        }
    }
}
