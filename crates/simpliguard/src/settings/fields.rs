//! The table of fields, and everything that is generated from it.

use serde::de::{Error as _, MapAccess};
use serde::{Deserialize, Serialize};

use super::atlas_size::AtlasSize;
use super::budgets::Budgets;
use super::choices::{
    Candidates, ExistingLods, InitialTexture, JointSplitting, LaplacianOf, LevelMaterials, MorphTargets, OnMiss,
    Quality, Resolution, Scope, SkinTransfer, SourceGeometry, TextureCompression, TextureSolver,
};
use super::field::{FieldInfo, PerQuality, ValueSeed, always, by_quality, check};
use super::target::Target;
use super::text::did_you_mean;
use super::texture_size::TextureSize;
use super::value::{Limit, Value};
use crate::Error;
use crate::data::{MaterialWeight, NodePattern, TextureFormat};

macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident: $type:ty = $default:expr, $limit:expr;
    )+) => {
        /// The settings of a bake. All fields are present and, if made by [`resolve`](super::resolve), in range.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        pub struct BakeSettings {
            $( $(#[doc = $doc])+ pub $name: $type, )+
        }

        /// The fields of [`BakeSettings`] that someone has set. In RON a field is written without `Some`. Reading
        /// checks that values are in range.
        #[derive(Clone, Debug, Default, PartialEq, Serialize)]
        pub struct BakeOverrides {
            $(
                $(#[doc = $doc])+
                #[serde(
                    skip_serializing_if = "Option::is_none",
                    serialize_with = "serde_with::rust::unwrap_or_skip::serialize"
                )]
                pub $name: Option<$type>,
            )+
        }

        /// The names of all fields, in their order.
        pub(super) const NAMES: &[&str] = &[$(stringify!($name)),+];

        impl BakeSettings {
            /// The built-in values at a quality.
            pub fn preset(quality: Quality) -> Self {
                let mut settings = Self { $( $name: PerQuality::<$type>::of($default, quality), )+ };
                settings.quality = quality;
                settings
            }

            /// Checks the ranges.
            ///
            /// # Errors
            /// The first field that is out of range.
            pub fn check(&self) -> Result<(), Error> {
                $( check(stringify!($name), &self.$name, $limit).map_err(Error::Settings)?; )+
                Ok(())
            }

            /// Takes the values of the fields that `overrides` sets. Returns for each field, in their order, if it was
            /// set.
            pub(super) fn apply(&mut self, overrides: BakeOverrides) -> Vec<bool> {
                let mut is_set = Vec::with_capacity(NAMES.len());
                $(
                    is_set.push(overrides.$name.is_some());
                    if let Some(value) = overrides.$name {
                        self.$name = value.normalised();
                    }
                )+
                is_set
            }

            /// With the built-in values of another quality where the values are those of this one.
            pub(super) fn at_quality(self, quality: Quality) -> Self {
                let (own, other) = (Self::preset(self.quality), Self::preset(quality));
                Self { $( $name: if self.$name == own.$name { other.$name } else { self.$name }, )+ }
            }

            /// Name and value as RON of each field, in their order.
            pub(super) fn entries(&self) -> Vec<(&'static str, String)> {
                vec![$( (stringify!($name), self.$name.ron()) ),+]
            }
        }

        impl BakeOverrides {
            /// Sets one field from its command-line spelling, such as `texture_size` and `2048`. Variants are
            /// kebab-case, and items of lists are separated by commas.
            ///
            /// # Errors
            /// If there is no such field, or if its value is malformed or out of range.
            pub fn set(&mut self, name: &str, value: &str) -> Result<(), Error> {
                // Users of command lines type `--set texture-size=..`.
                let field = name.replace('-', "_");
                $(
                    if field == stringify!($name) {
                        let value = <$type>::from_arg(value)
                            .map_err(|expected| Error::Settings(format!("{field}={value}: expected {expected}")))?;
                        check(stringify!($name), &value, $limit).map_err(Error::Settings)?;
                        self.$name = Some(value);
                        return Ok(());
                    }
                )+
                Err(Error::Settings(format!("unknown field '{name}'{}", did_you_mean(&field, NAMES))))
            }

            /// Name and value as RON of each field that is set, in their order.
            pub(super) fn entries(&self) -> Vec<(&'static str, String)> {
                [$( (stringify!($name), self.$name.as_ref().map(Value::ron)) ),+]
                    .into_iter()
                    .filter_map(|(name, value)| Some((name, value?)))
                    .collect()
            }

            /// Reads the value of `name`, which is one of [`NAMES`].
            pub(super) fn read<'de, A: MapAccess<'de>>(&mut self, name: &'static str, map: &mut A) -> Result<(), A::Error> {
                $(
                    if name == stringify!($name) {
                        if self.$name.is_some() {
                            return Err(A::Error::duplicate_field(name));
                        }
                        self.$name = Some(map.next_value_seed(ValueSeed::<$type>::new(name, $limit))?);
                    }
                )+
                Ok(())
            }
        }

        /// The documentation of all fields, in their order.
        pub fn reference() -> Vec<FieldInfo> {
            let defaults = [Quality::Draft, Quality::Standard, Quality::Best].map(BakeSettings::preset);
            vec![$(
                FieldInfo {
                    name: stringify!($name),
                    doc: [$($doc),+].map(str::trim).join(" "),
                    accepts: <$type>::accepts($limit),
                    defaults: if stringify!($name) == "quality" {
                        [(); 3].map(|()| Quality::default().ron())
                    } else {
                        defaults.each_ref().map(|d| d.$name.ron())
                    },
                }
            ),+]
        }
    };
}

/// Settings of the objects of a scene whose names match.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectRule {
    /// Glob over the names of objects, `Rock*`; upper and lower case differ. An object has the name of its node, or else that
    /// of its mesh.
    pub node: String,
    /// The fields that are set for these objects.
    pub settings: BakeOverrides,
}

settings! {
    /// Makes levels of detail. If false, the file passes through unchanged.
    enabled: bool = always(true), Limit::None;
    /// Largest number of triangles of each level. The smallest number becomes LOD1. With `scope: Objects`, a level also
    /// has at most half the triangles of the next more detailed one.
    faces: Vec<u32> = always(vec![1000, 2000, 4000]), Limit::Between(4.0, 1e6);
    /// Targets of the levels, in place of `faces`. A target is a number of triangles, a fraction of the source's
    /// triangles, or a deviation from the source. A deviation is a fraction of the bounding box's diagonal, or one
    /// pixel on a screen on which that diagonal is so many pixels long.
    targets: Vec<Target> = always(Vec::new()), Limit::None;
    /// Time that a bake may take. Fields that nobody sets take their value from it.
    quality: Quality = always(Quality::Standard), Limit::None;
    /// Treatment of a file that already has levels of detail.
    existing_lods: ExistingLods = always(ExistingLods::Keep), Limit::None;
    /// Treatment of the source's own geometry, which comes before the levels in the output. `OnDemand` is for games with this
    /// plugin: they load the source, and levels but for the smallest, when somebody comes near, and drop them later. The command
    /// takes it for `Keep`.
    source: SourceGeometry = always(SourceGeometry::Keep), Limit::None;
    /// What gets levels: the whole scene of a file, or each of its objects. An object is a node with a mesh, or a skin
    /// with all that hangs on its joints. Equal objects share their levels.
    scope: Scope = always(Scope::Scene), Limit::None;
    /// Names of nodes that are one object together with all nodes below them, with `scope: Objects`: `["Lamp*"]`.
    objects: Vec<NodePattern> = always(Vec::new()), Limit::None;
    /// Fewest triangles of an object that gets levels, with `scope: Objects`. Smaller ones stay as they are.
    object_faces: u32 = always(100), Limit::Between(8.0, 1e6);
    /// Settings of objects by the names of their nodes, with `scope: Objects`:
    /// `[(node: "Rock*", settings: (faces: [100, 300]))]`. Later rules win.
    object_rules: Vec<ObjectRule> = always(Vec::new()), Limit::None;
    /// Largest numbers of triangles of levels that stand for all objects at once, with `scope: Objects`: `[1000]`. Seen
    /// from afar, one mesh of the whole file replaces the levels of its objects. It is baked again when anything in the
    /// file moves.
    whole: Budgets = always(Budgets::default()), Limit::Between(4.0, 1e6);
    /// Largest side of one set of square textures that the smallest levels of all objects share, in texels, with
    /// `scope: Objects`: `2048`. So a game draws them with one material. Levels are halved in resolution until all fit.
    shared_atlas: AtlasSize = always(AtlasSize::Off), Limit::PowerOfTwo(64, 8192);
    /// Cells of the reconstruction along the longest side of the model.
    resolution: Resolution = always(Resolution::Auto), Limit::Between(32.0, 512.0);
    /// Cells of the finest reconstruction that `resolution: Auto` generates. One of more than 256 cells is generated
    /// only if the best shape intersects itself.
    finest_resolution: u32 = by_quality(256, 384, 512), Limit::Between(32.0, 512.0);
    /// Materials of the levels: one that is baked, with an atlas of its own. With `Auto`, those of the source where a level looks
    /// clearly more like it with them, as levels do that have a good part of the source's triangles. This takes more draw calls
    /// and no memory for textures. A level never keeps them if `source` is not `Keep`.
    materials: LevelMaterials = always(LevelMaterials::Auto), Limit::None;
    /// Surfaces that compete for each level.
    candidates: Candidates = always(Candidates::All), Limit::None;
    /// Removes faces that no ray from outside reaches.
    remove_invisible: bool = always(true), Limit::None;
    /// Number of random rays from each vertex of a shape that has met its budget. Faces are removed if no ray from any of
    /// their vertices leaves the shape, as in the paper. With 0, none are.
    invisible_rays: u32 = always(0), Limit::Between(0.0, 1000.0);
    /// Fraction of a face's quadric weight that comes from its visible size. With 0, faces weigh by their area alone.
    visible_weight: f32 = always(0.9), Limit::Between(0.0, 1.0);
    /// Weight of the curvature quadric (alpha in the paper). It keeps faces where the surface bends.
    curvature: f32 = always(0.0), Limit::Between(0.0, 10.0);
    /// Sum of the angles at a vertex, in radians, between its normal and those of its faces at which the curvature of the
    /// quadric is a half. It is one on flats, and lower where the surface bends more.
    curvature_angle: f32 = always(0.001), Limit::Between(0.0001, 100.0);
    /// Weights of the faces of some materials, such as `[(material: "*Face*", weight: 4.0)]`. Other faces have the
    /// weight 1. The last entry that matches a material's name applies.
    importance: Vec<MaterialWeight> = always(Vec::new()), Limit::None;
    /// Weight of faces where the red channel of the second vertex colour, `COLOR_1`, is one. A red of zero gives
    /// the weight 1.
    painted_importance: f32 = always(1.0), Limit::Between(0.01, 100.0);
    /// Makes closed levels. They also keep the faces that nobody sees.
    watertight: bool = always(false), Limit::None;
    /// Method that gives a level its joint weights.
    skin_transfer: SkinTransfer = always(SkinTransfer::ClosestSurface), Limit::None;
    /// Fewest faces of a level that a joint moves, together with its descendants. Joints that move fewer are replaced
    /// by the joint above, and the level's skin does not list them. With 0, all joints stay.
    bone_faces: f32 = always(0.0), Limit::Between(0.0, 1000.0);
    /// Treatment of the source's morph targets.
    morph_targets: MorphTargets = always(MorphTargets::Transfer), Limit::None;
    /// Splits faces along the planes where limbs bend: never, before texture coordinates are made, or at the end. Each
    /// budget keeps as many faces free as the split adds.
    joint_planes: JointSplitting = always(JointSplitting::Off), Limit::None;
    /// Largest difference between the two largest weights of the vertices that a joint plane goes through (delta in the
    /// paper).
    joint_delta: f32 = always(0.1), Limit::Between(0.001, 1.0);
    /// Number of poses that decide on the shape of the levels, in addition to the rest pose. Poses are frames of the
    /// source's clips, or rotations of its joints if it has no clips. Textures and vertices are fitted to more poses:
    /// up to half as many as there are views. With 0, the rest pose alone counts.
    poses: u32 = by_quality(2, 4, 6), Limit::Between(0.0, 16.0);
    /// Side of each level's square textures, in texels. Levels of at most 1,000 faces have textures of half this size. A
    /// list has the size of each level, the smallest level first; its last number is for all levels beyond. With `Auto`,
    /// a level's textures are as large as they are seen where the level comes into view, and at most as large as by
    /// default.
    texture_size: TextureSize = by_quality(512.into(), 1024.into(), 1024.into()), Limit::PowerOfTwo(64, 4096);
    /// Texels for each pixel along a side of the textures that `texture_size: Auto` gives a level. Games that set
    /// `pixel_error` below 1, or a bias above 1, see levels from nearer by: 2 suits half the distance.
    texture_oversampling: f32 = always(1.0), Limit::Between(0.25, 8.0);
    /// Format of colour textures. `Jpeg(90)` takes a fraction of the bytes of PNG. Images with alpha stay PNG, and so
    /// do images that are not colours: normals, occlusion, roughness and metalness.
    texture_format: TextureFormat = always(TextureFormat::Png), Limit::Between(1.0, 100.0);
    /// Form of the textures of levels and source in the file that has both. `Bc` is for games with this plugin: blocks of
    /// BC7 with mipmaps, which take a quarter of the memory of a GPU; other programs see small images. `Off` is for
    /// everybody: PNG and JPEG. `Auto` is `Bc` where a game imports its models, and `Off` where the command bakes.
    texture_compression: TextureCompression = always(TextureCompression::Auto), Limit::None;
    /// Distance between charts, in texels.
    gutter: u32 = always(4), Limit::Between(1.0, 16.0);
    /// Gives each level a normal map with the detail of the source.
    normal_map: bool = always(true), Limit::None;
    /// Number of views of the source. Candidates are scored by them, and textures and vertices are fitted to them.
    views: u32 = by_quality(32, 48, 80), Limit::Between(8.0, 256.0);
    /// Side of each square view, in pixels.
    view_size: u32 = always(512), Limit::Between(128.0, 2048.0);
    /// Fits texture and vertices to the views by differentiable rendering. If false, both stay as they were made.
    refine: bool = always(true), Limit::None;
    /// Number of optimisation steps by differentiable rendering. Levels of more than 2,000 faces take a third of them.
    /// With 0, the vertices stay where they are.
    refine_steps: u32 = by_quality(0, 400, 800), Limit::Between(0.0, 2000.0);
    /// Fraction of the steps, the first ones, that compare images of half the size. Such a step takes a quarter of the
    /// time. Levels of more than 2,000 faces have none.
    coarse_steps: f32 = always(0.9), Limit::Between(0.0, 1.0);
    /// Number of views that the steps at half size have in addition to those at full size. With more views, the
    /// vertices suit other views better.
    coarse_views: u32 = always(128), Limit::Between(0.0, 256.0);
    /// Fits joint weights to the poses: first over the faces between the vertices, then together with the vertices.
    refine_weights: bool = always(true), Limit::None;
    /// Texture before it is fitted to the views. Textures of cut-outs are always baked.
    initial_texture: InitialTexture = always(InitialTexture::Baked), Limit::None;
    /// Radius in texels of the circles that `initial_texture: Projected` copies around each pixel of a view. With 0, each
    /// pixel gives one texel.
    projection_radius: u32 = always(2), Limit::Between(0.0, 16.0);
    /// Solver that fits textures to the views.
    texture_solver: TextureSolver = always(TextureSolver::LeastSquares), Limit::None;
    /// Number of steps each time that `texture_solver: Adam` fits a texture.
    texture_steps: u32 = always(200), Limit::Between(0.0, 5000.0);
    /// Weight that keeps neighbouring texels from changing differently. It counts most where the views say little.
    texture_smoothness: f32 = always(0.1), Limit::Between(0.0, 10.0);
    /// Standard deviation in texels of the random perturbations in the texture loss of `texture_solver: Adam` (`L_tex` in
    /// the paper). With 0, neighbouring texels are compared, and by their changes alone.
    texture_perturbation: f32 = always(0.0), Limit::Between(0.0, 16.0);
    /// Weight of the error of the image gradient, where the error of the image has the weight 1 (`L_img` in the paper).
    /// It counts when vertices are moved, and when `Adam` fits textures.
    gradient_weight: f32 = always(0.5), Limit::Between(0.0, 10.0);
    /// Weight of the Laplacian of the vertex displacements (`L_laplacian` in the paper), in squared radii of the model.
    laplacian_weight: f32 = always(0.02), Limit::Between(0.0, 10.0);
    /// The vectors that `laplacian_weight` is for.
    laplacian_of: LaplacianOf = always(LaplacianOf::Displacements), Limit::None;
    /// Weight of the mean squared distance to the source, in squared mean edge lengths of the level. It keeps the
    /// surface near the source where images say nothing. In steps at half size it is smaller, in proportion to the
    /// views that `coarse_views` adds.
    distance_weight: f32 = always(3.0), Limit::Between(0.0, 1000.0);
    /// Weight of the cosines between neighbouring vertex normals (`L_normal` in the paper).
    normal_weight: f32 = always(0.0), Limit::Between(0.0, 10.0);
    /// Largest displacement of a vertex in the first step, as a fraction of the mean edge length. Later steps are
    /// shorter.
    step_length: f32 = always(0.02), Limit::Between(0.0001, 0.1);
    /// PSNR in dB, over the pixels that a level or its source touches, below which the report says that the level does not
    /// look like its source, and where. With 0, nothing is said.
    warn_below: f32 = always(12.0), Limit::Between(0.0, 60.0);
    /// Least PSNR in dB of each level, measured as for `warn_below`. With 0, nothing is asked.
    min_psnr: f32 = always(0.0), Limit::Between(0.0, 60.0);
    /// Least intersection over union of the silhouettes of each level and its source. With 0, nothing is asked.
    min_silhouette_iou: f32 = always(0.0), Limit::Between(0.0, 1.0);
    /// Largest deviation of each level: the distance that 95 % of both surfaces stay within, as a fraction of the bounding
    /// box's diagonal. With 1, nothing is asked.
    max_deviation: f32 = always(1.0), Limit::Between(0.0001, 1.0);
    /// What happens to a level that misses `min_psnr`, `min_silhouette_iou` or `max_deviation`. `RaiseBudget` makes it again
    /// with half as many more faces, up to four times its budget and less than the next level has; a level that still
    /// misses is reported. `Fail` bakes no levels for the model.
    on_miss: OnMiss = always(OnMiss::Warn), Limit::None;
}

impl Default for BakeSettings {
    fn default() -> Self {
        Self::preset(Quality::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_values_are_in_range() {
        for quality in [Quality::Draft, Quality::Standard, Quality::Best] {
            BakeSettings::preset(quality).check().expect("presets are valid");
        }
    }

    #[test]
    fn command_line_spelling_is_kebab_case() {
        let mut o = BakeOverrides::default();
        for (name, value) in [
            ("quality", "best"),
            ("skin-transfer", "nearest-vertices"),
            ("resolution", "128"),
            ("faces", "500, 100"),
            ("visible_weight", "0.5"),
            ("texture-format", "jpeg-85"),
        ] {
            o.set(name, value).expect(name);
        }
        assert_eq!(o.quality, Some(Quality::Best));
        assert_eq!(o.skin_transfer, Some(SkinTransfer::NearestVertices));
        assert_eq!(o.resolution, Some(Resolution::Cells(128)));
        assert_eq!(o.faces, Some(vec![500, 100]));
        assert_eq!(o.visible_weight, Some(0.5));
        assert_eq!(o.texture_format, Some(TextureFormat::Jpeg(85)));
        for value in ["raise-budget", "RaiseBudget"] {
            o.set("on_miss", value).expect("a choice");
            assert_eq!(o.on_miss.take(), Some(OnMiss::RaiseBudget));
        }
        o.set("resolution", "auto").expect("auto");
        assert_eq!(o.resolution, Some(Resolution::Auto));
    }

    #[test]
    fn bad_command_line_values_are_explained() {
        let message = |name, value| BakeOverrides::default().set(name, value).expect_err(name).to_string();
        assert_eq!(
            message("texture_sise", "1"),
            "settings: unknown field 'texture_sise'; did you mean 'texture_size'?"
        );
        assert_eq!(message("quality", "good"), "settings: quality=good: expected draft, standard or best");
        assert_eq!(
            message("texture_size", "1000"),
            "settings: texture_size: 1000 is out of range: expected a power of two from 64 to 4096, a list of 1 to 8 of \
             them, or Auto; the \
             nearest is 1024"
        );
        assert_eq!(
            message("faces", "1000,2"),
            "settings: faces: [1000, 2] is out of range: expected 1 to 8 whole numbers, each from 4 to 1000000; the \
             nearest is [1000, 4]"
        );
        assert!(message("step_length", "7").ends_with("a number from 0.0001 to 0.1; the nearest is 0.1"));
        assert!(message("resolution", "4096").ends_with("; the nearest is Cells(512)"));
        assert!(message("step_length", "nan").contains("a number from 0.0001 to 0.1"));
    }

    #[test]
    fn range_ends_are_inside() {
        for (name, value) in [("step_length", "0.0001"), ("step_length", "0.1"), ("views", "256"), ("faces", "4")] {
            BakeOverrides::default().set(name, value).expect(name);
        }
    }

    #[test]
    fn the_reference_covers_every_field() {
        let fields = reference();
        assert_eq!(fields.len(), NAMES.len());
        assert!(fields.iter().all(|f| !f.doc.is_empty() && !f.accepts.is_empty()));
        let presets: Vec<_> = fields.iter().filter(|f| f.is_preset()).map(|f| f.name).collect();
        assert_eq!(presets, ["finest_resolution", "poses", "texture_size", "views", "refine_steps"]);
    }
}
