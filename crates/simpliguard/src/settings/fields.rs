//! The list of fields, and everything that is generated from it.

use std::marker::PhantomData;

use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::resolve::{Layer, Origin, Resolved};
use super::target::Target;
use super::text::did_you_mean;
use super::value::{Limit, Resolution, TextureFormat, Value, choice};
use crate::Error;
use crate::data::MaterialWeight;

choice! {
    /// How much time is spent. Supplies the values of fields that no layer sets.
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
    /// What happens to a file that already has levels of detail.
    pub enum ExistingLods {
        /// The file passes through unchanged.
        #[default]
        Keep,
        /// Its own levels are dropped and made anew from the finest.
        Replace,
    }
}

choice! {
    /// Whether the output holds the source's own geometry.
    pub enum SourceGeometry {
        /// The source comes first, unchanged.
        #[default]
        Keep,
        /// Meshes and textures of the source are left out; its nodes and clips stay.
        Drop,
    }
}

choice! {
    /// Which surfaces compete for each level.
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
    /// How a level gets its joint weights.
    pub enum SkinTransfer {
        /// From the closest point of the source's surface.
        #[default]
        ClosestSurface,
        /// From the nearest vertices of the source, weighted by distance.
        NearestVertices,
    }
}

choice! {
    /// What becomes of the source's morph targets.
    pub enum MorphTargets {
        /// The levels have them too, and clips morph them with the source.
        #[default]
        Transfer,
        /// The levels stay as the default weights make them.
        Drop,
    }
}

choice! {
    /// When faces are split along the planes where limbs bend.
    pub enum JointPlanes {
        /// Never.
        #[default]
        Off,
        /// Before texture coordinates are made, so that refinement fits the new vertices too.
        BeforeUnwrap,
        /// At the end, as in the paper: the texture stays as it is.
        AfterRefine,
    }
}

choice! {
    /// What a texture is made of before it is fitted to the views.
    pub enum InitialTexture {
        /// What the source shows along the level's normals.
        #[default]
        Baked,
        /// One grey.
        Grey,
    }
}

choice! {
    /// How textures are fitted to the views.
    pub enum TextureSolver {
        /// The exact minimum of the squared error, by conjugate gradients.
        #[default]
        LeastSquares,
        /// `texture_steps` steps of descent, as in the paper.
        Adam,
    }
}

/// A built-in value for each quality.
struct PerQuality<T> {
    draft: T,
    standard: T,
    best: T,
}

impl<T> PerQuality<T> {
    fn of(self, quality: Quality) -> T {
        match quality {
            Quality::Draft => self.draft,
            Quality::Standard => self.standard,
            Quality::Best => self.best,
        }
    }
}

fn always<T: Clone>(value: T) -> PerQuality<T> {
    PerQuality { draft: value.clone(), standard: value.clone(), best: value }
}

fn by_quality<T>(draft: T, standard: T, best: T) -> PerQuality<T> {
    PerQuality { draft, standard, best }
}

/// What the reference says about one field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldInfo {
    /// As written in RON and after `--set`.
    pub name: &'static str,
    /// One or more sentences.
    pub doc: String,
    /// What kind of value it takes, with its range or its choices.
    pub accepts: String,
    /// Built-in values as RON for the qualities draft, standard and best.
    pub defaults: [String; 3],
}

impl FieldInfo {
    /// Whether the built-in value depends on the quality.
    pub fn is_preset(&self) -> bool {
        self.defaults.iter().any(|d| *d != self.defaults[0])
    }
}

macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident: $type:ty = $default:expr, $limit:expr;
    )+) => {
        /// Everything a bake reads: all fields present and, when made by [`super::resolve`], in range.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        pub struct BakeSettings {
            $( $(#[doc = $doc])+ pub $name: $type, )+
        }

        /// The fields of [`BakeSettings`] that someone has set. In RON a field is written without `Some`; values are
        /// checked against their ranges as they are read.
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

        const NAMES: &[&str] = &[$(stringify!($name)),+];

        impl BakeSettings {
            /// The built-in values at a quality.
            pub fn preset(quality: Quality) -> Self {
                let mut settings = Self { $( $name: PerQuality::<$type>::of($default, quality), )+ };
                settings.quality = quality;
                settings
            }

            /// `Err` names the first field that is out of range.
            pub fn check(&self) -> Result<(), Error> {
                $( check(stringify!($name), &self.$name, $limit).map_err(Error::Settings)?; )+
                Ok(())
            }

            /// Name and value as RON of each field, in the order of the list.
            pub(super) fn entries(&self) -> Vec<(&'static str, String)> {
                vec![$( (stringify!($name), self.$name.ron()) ),+]
            }
        }

        impl BakeOverrides {
            /// Sets one field from its command-line spelling: `texture_size`, `2048`. Names of variants are kebab-case,
            /// items of lists are separated by commas.
            pub fn set(&mut self, name: &str, value: &str) -> Result<(), Error> {
                // `--set texture-size=..` is what a hand used to command lines types.
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

            /// Reads the value of `name`, which is one of [`NAMES`].
            fn read<'de, A: MapAccess<'de>>(&mut self, name: &'static str, map: &mut A) -> Result<(), A::Error> {
                $(
                    if name == stringify!($name) {
                        if self.$name.is_some() {
                            return Err(A::Error::duplicate_field(name));
                        }
                        let field = Field { name, limit: $limit, of: PhantomData::<$type> };
                        self.$name = Some(map.next_value_seed(field)?);
                    }
                )+
                Ok(())
            }
        }

        /// Lays `layers` over the built-in values, the last on top.
        pub(super) fn lay(quality: (Quality, Origin), layers: Vec<Layer>) -> Resolved {
            let (quality, quality_origin) = quality;
            let mut settings = BakeSettings::preset(quality);
            let mut origins: Vec<Origin> = reference()
                .iter()
                .map(|field| if field.is_preset() { Origin::Preset(quality) } else { Origin::BuiltIn })
                .collect();
            for Layer { origin, overrides } in layers {
                let mut origins = origins.iter_mut();
                $(
                    let slot = origins.next();
                    if let (Some(slot), Some(value)) = (slot, overrides.$name) {
                        settings.$name = value.normalised();
                        *slot = origin.clone();
                    }
                )+
            }
            for (name, origin) in NAMES.iter().zip(&mut origins) {
                if *name == "quality" {
                    *origin = quality_origin.clone();
                }
            }
            Resolved { settings, origins }
        }

        /// Every field with its documentation, in the order of the list.
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

fn check<T: Value>(name: &str, value: &T, limit: Limit) -> Result<(), String> {
    value.check(limit).map_err(|expected| {
        let nearest = value.nearest(limit).map(|n| format!("; the nearest is {}", n.ron())).unwrap_or_default();
        format!("{name}: {} is out of range: expected {expected}{nearest}", value.ron())
    })
}

settings! {
    /// Whether the file gets levels of detail at all; if not, it passes through.
    enabled: bool = always(true), Limit::None;
    /// Most triangles of each level. The smallest becomes LOD1.
    faces: Vec<u32> = always(vec![1000, 2000, 4000]), Limit::Between(4.0, 1e6);
    /// What each level must meet, in place of `faces`: a number or a part of the triangles, or a deviation, as a fraction of
    /// the bounding box's diagonal or as a pixel where that diagonal is so many pixels long.
    targets: Vec<Target> = always(Vec::new()), Limit::None;
    /// How much time is spent. Fields that nobody sets take their value from it.
    quality: Quality = always(Quality::Standard), Limit::None;
    /// What happens to a file that already has levels of detail.
    existing_lods: ExistingLods = always(ExistingLods::Keep), Limit::None;
    /// Whether the output holds the source's own geometry in front of the levels.
    source: SourceGeometry = always(SourceGeometry::Keep), Limit::None;
    /// Cells of the reconstruction along the longest side of the model.
    resolution: Resolution = always(Resolution::Auto), Limit::Between(32.0, 512.0);
    /// Cells of the finest reconstruction that `resolution: Auto` tries; one of more than 256 only where parts of the best
    /// shape pass through each other.
    finest_resolution: u32 = by_quality(256, 384, 512), Limit::Between(32.0, 512.0);
    /// Which surfaces compete for each level.
    candidates: Candidates = always(Candidates::All), Limit::None;
    /// Whether faces that no ray from outside reaches are dropped.
    remove_invisible: bool = always(true), Limit::None;
    /// How much of a quadric's weight depends on how visible its faces are; 0 weighs all faces by area alone.
    visible_weight: f32 = always(0.9), Limit::Between(0.0, 1.0);
    /// Weight of the curvature quadric (alpha in the paper), which keeps faces where the surface bends.
    curvature: f32 = always(0.0), Limit::Between(0.0, 10.0);
    /// Materials whose faces count more, or less, than others, such as `[(material: "*Face*", weight: 4.0)]`; the last that
    /// matches a material's name applies.
    importance: Vec<MaterialWeight> = always(Vec::new()), Limit::None;
    /// How much more faces count where the red of the second vertex colour, `COLOR_1`, is one; where it is zero they do not.
    painted_importance: f32 = always(1.0), Limit::Between(0.01, 100.0);
    /// Whether the levels must stay closed, at the cost of faces that nobody sees.
    watertight: bool = always(false), Limit::None;
    /// How a level gets its joint weights.
    skin_transfer: SkinTransfer = always(SkinTransfer::ClosestSurface), Limit::None;
    /// Skeleton that move less than so many faces of a level, with all that hangs on them, give way to the joint above in it, and
    /// its skin lists only those that are left; 0 keeps all.
    bone_faces: f32 = always(0.0), Limit::Between(0.0, 1000.0);
    /// What becomes of the source's morph targets.
    morph_targets: MorphTargets = always(MorphTargets::Transfer), Limit::None;
    /// Whether and when faces are split along the planes where limbs bend. Their number is kept free in each budget.
    joint_planes: JointPlanes = always(JointPlanes::Off), Limit::None;
    /// Largest difference of the two largest weights of a vertex between two bones (delta in the paper), which is where
    /// the planes are.
    joint_delta: f32 = always(0.1), Limit::Between(0.001, 1.0);
    /// Number of frames of the source's clips, or of turns of its joints if it has none, that decide on the shape of levels
    /// besides the rest pose; what follows is fitted to half as many as there are views. 0 takes the rest pose alone.
    poses: u32 = by_quality(2, 4, 6), Limit::Between(0.0, 16.0);
    /// Side of each level's square textures, in texels; levels of at most 1,000 faces get half of it.
    texture_size: u32 = by_quality(512, 1024, 1024), Limit::PowerOfTwo(64, 4096);
    /// How colours are stored: `Jpeg(90)` takes a fraction of the bytes. Images with alpha, and those that are no colours
    /// (normals, occlusion, roughness and metalness), stay PNG.
    texture_format: TextureFormat = always(TextureFormat::Png), Limit::Between(1.0, 100.0);
    /// Distance between charts, in texels.
    gutter: u32 = always(4), Limit::Between(1.0, 16.0);
    /// Whether a level gets a normal map with the source's detail.
    normal_map: bool = always(true), Limit::None;
    /// Number of views that textures are made from and refined against.
    views: u32 = by_quality(32, 48, 80), Limit::Between(8.0, 256.0);
    /// Side of each square view, in pixels.
    view_size: u32 = always(512), Limit::Between(128.0, 2048.0);
    /// Whether differentiable rendering fits texture and vertices to the views; if not, both stay as they were made.
    refine: bool = always(true), Limit::None;
    /// Number of optimisation steps by differentiable rendering, a third of it in levels of more than 2,000 faces; 0 leaves the
    /// vertices where they are.
    refine_steps: u32 = by_quality(0, 400, 800), Limit::Between(0.0, 2000.0);
    /// Part of the steps, the first ones, that compare pictures of half the size, in levels of at most 2,000 faces: they cost a
    /// quarter.
    coarse_steps: f32 = always(0.9), Limit::Between(0.0, 1.0);
    /// Number of views that these steps have besides those at full size: the more, the better vertices suit others.
    coarse_views: u32 = always(128), Limit::Between(0.0, 256.0);
    /// Whether joint weights are fitted to the poses: over the faces between vertices first, and then together with the
    /// vertices.
    refine_weights: bool = always(true), Limit::None;
    /// What a texture is made of before it is fitted to the views. Cut-outs are always baked.
    initial_texture: InitialTexture = always(InitialTexture::Baked), Limit::None;
    /// How textures are fitted to the views.
    texture_solver: TextureSolver = always(TextureSolver::LeastSquares), Limit::None;
    /// Number of steps each time `texture_solver: Adam` fits a texture.
    texture_steps: u32 = always(200), Limit::Between(0.0, 5000.0);
    /// How strongly neighbouring texels are kept from changing apart where the views say little.
    texture_smoothness: f32 = always(0.1), Limit::Between(0.0, 10.0);
    /// Weight of the error of the image gradient, the image's own being 1 (`L_img` in the paper), where vertices are moved
    /// and where textures are fitted by `Adam`.
    gradient_weight: f32 = always(0.5), Limit::Between(0.0, 10.0);
    /// Weight of the Laplacian of how far vertices have moved (`L_laplacian` in the paper), in squared radii of the model.
    laplacian_weight: f32 = always(0.02), Limit::Between(0.0, 10.0);
    /// Weight of the mean squared distance to the source, in squared mean edges of the level: what pictures do not tell stays
    /// near the surface. Beside `coarse_views` it is as much less as they are more.
    distance_weight: f32 = always(3.0), Limit::Between(0.0, 1000.0);
    /// Weight of the cosines between neighbouring vertex normals (`L_normal` in the paper).
    normal_weight: f32 = always(0.0), Limit::Between(0.0, 10.0);
    /// Longest way of a vertex in the first step, as a fraction of the mean edge length; the steps get shorter.
    step_length: f32 = always(0.02), Limit::Between(0.0001, 0.1);
}

impl Default for BakeSettings {
    fn default() -> Self {
        Self::preset(Quality::default())
    }
}

impl<'de> Deserialize<'de> for BakeOverrides {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_struct("BakeOverrides", NAMES, OverridesVisitor)
    }
}

struct OverridesVisitor;

impl<'de> Visitor<'de> for OverridesVisitor {
    type Value = BakeOverrides;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("bake settings, such as (faces: [1000], quality: Draft)")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<BakeOverrides, A::Error> {
        let mut overrides = BakeOverrides::default();
        while let Some(FieldName(name)) = map.next_key()? {
            overrides.read(name, &mut map)?;
        }
        Ok(overrides)
    }
}

/// Reads one value and checks it before the parser moves on, so that an error has the value's position.
struct Field<T> {
    name: &'static str,
    limit: Limit,
    of: PhantomData<T>,
}

impl<'de, T: Value + Deserialize<'de>> DeserializeSeed<'de> for Field<T> {
    type Value = T;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<T, D::Error> {
        let name = self.name;
        let explained = |e| D::Error::custom(format!("{name}: expected {} ({e})", T::accepts(self.limit)));
        let value = T::deserialize(deserializer).map_err(explained)?;
        check(name, &value, self.limit).map_err(D::Error::custom)?;
        Ok(value)
    }
}

/// The name of a field that exists.
struct FieldName(&'static str);

impl<'de> Deserialize<'de> for FieldName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameVisitor;

        impl Visitor<'_> for NameVisitor {
            type Value = FieldName;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the name of a setting")
            }

            fn visit_str<E: serde::de::Error>(self, found: &str) -> Result<FieldName, E> {
                let known = NAMES.iter().find(|name| **name == found);
                known.map(|name| FieldName(name)).ok_or_else(|| E::unknown_field(found, NAMES))
            }
        }

        deserializer.deserialize_identifier(NameVisitor)
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
            "settings: texture_size: 1000 is out of range: expected a power of two from 64 to 4096; the \
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
