//! Layers of overrides, and the settings they add up to.

use std::fmt;

use super::choices::{LevelMaterials, Quality, SourceGeometry};
use super::field::FieldInfo;
use super::fields::{BakeOverrides, BakeSettings, reference};
use super::overrides::parse_overrides;
use crate::Error;

/// The origin of a value. File names are as the caller gave them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Built in, the same at every quality.
    BuiltIn,
    /// Built in, by the quality in effect.
    Preset(Quality),
    /// `defaults` of the project file.
    Project {
        /// The project file.
        file: String,
    },
    /// A rule of the project file.
    Rule {
        /// The project file.
        file: String,
        /// The rule's pattern.
        glob: String,
    },
    /// A profile of the project file.
    Profile {
        /// The project file.
        file: String,
        /// The profile's name.
        name: String,
    },
    /// The `.meta` file beside the model.
    Meta {
        /// The `.meta` file.
        file: String,
    },
    /// A settings file named on the command line.
    File {
        /// The settings file.
        file: String,
    },
    /// The command line itself.
    CommandLine,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn => f.write_str("built in"),
            Self::Preset(quality) => write!(f, "quality {quality:?}"),
            Self::Project { file } => write!(f, "{file}, defaults"),
            Self::Rule { file, glob } => write!(f, "{file}, rule \"{glob}\""),
            Self::Profile { file, name } => write!(f, "{file}, profile \"{name}\""),
            Self::Meta { file } | Self::File { file } => f.write_str(file),
            Self::CommandLine => f.write_str("command line"),
        }
    }
}

/// Overrides and their origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The origin.
    pub origin: Origin,
    /// The fields that are set.
    pub overrides: BakeOverrides,
}

/// Settings with the origin of each value.
#[derive(Clone, Debug, PartialEq)]
pub struct Resolved {
    /// The settings: in range, lists of budgets sorted and without repetition.
    pub settings: BakeSettings,
    /// In the order of the fields.
    origins: Vec<Origin>,
}

/// One field of [`Resolved`].
#[derive(Clone, Debug, PartialEq)]
pub struct Effective<'a> {
    /// The name of the field.
    pub name: &'static str,
    /// Its value as RON.
    pub value: String,
    /// The origin of the value.
    pub origin: &'a Origin,
}

impl Resolved {
    /// Every field with value and origin, in the order of the reference.
    pub fn effective(&self) -> impl Iterator<Item = Effective<'_>> {
        let entries = self.settings.entries().into_iter();
        entries.zip(&self.origins).map(|((name, value), origin)| Effective { name, value, origin })
    }

    /// The origin of the value of a field; `None` if there is no such field.
    pub fn origin(&self, field: &str) -> Option<&Origin> {
        self.effective().find(|e| e.name == field).map(|e| e.origin)
    }
}

impl BakeSettings {
    /// All fields as RON.
    pub fn to_ron(&self) -> String {
        let fields: Vec<String> = self.entries().iter().map(|(name, value)| format!("{name}: {value}")).collect();
        format!("({})", fields.join(", "))
    }

    /// The settings of which this is [`Self::to_ron`]. A field that is missing has its built-in value.
    ///
    /// # Errors
    /// If the text is malformed, or a value is out of range.
    pub fn from_ron(text: &str) -> Result<Self, Error> {
        let overrides = parse_overrides(text, "settings")?;
        resolve(vec![Layer { origin: Origin::CommandLine, overrides }]).map(|resolved| resolved.settings)
    }
}

/// Lays overrides over the built-in values, each layer over those before it: project defaults, matching rules, profile,
/// `.meta`, settings file, command line. The quality is the last one of all layers; its built-in values lie below all
/// of them. Levels without their source beside them get materials of their own: they would keep its textures in memory.
///
/// # Errors
/// If a value is out of range. Overrides that were read from text are in range.
pub fn resolve(layers: Vec<Layer>) -> Result<Resolved, Error> {
    let quality = layers.iter().rev().find_map(|layer| layer.overrides.quality).unwrap_or_default();
    let mut settings = BakeSettings::preset(quality);
    let mut origins: Vec<Origin> = reference().iter().map(|field| built_in(field, quality)).collect();
    for Layer { origin, overrides } in layers {
        let is_set = settings.apply(overrides);
        for (slot, _) in origins.iter_mut().zip(is_set).filter(|(_, is_set)| *is_set) {
            *slot = origin.clone();
        }
    }
    if settings.source != SourceGeometry::Keep {
        settings.materials = LevelMaterials::Baked;
    }
    settings.check()?;
    Ok(Resolved { settings, origins })
}

/// The origin of the built-in value of a field.
fn built_in(field: &FieldInfo, quality: Quality) -> Origin {
    if field.is_preset() { Origin::Preset(quality) } else { Origin::BuiltIn }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(origin: Origin, set: &[(&str, &str)]) -> Layer {
        let mut overrides = BakeOverrides::default();
        for (name, value) in set {
            overrides.set(name, value).expect(name);
        }
        Layer { origin, overrides }
    }

    fn project() -> Origin {
        Origin::Project { file: "config/simpliguard.ron".into() }
    }

    #[test]
    fn nothing_set_gives_the_built_in_values() {
        let resolved = resolve(Vec::new()).expect("valid");
        assert_eq!(resolved.settings, BakeSettings::default());
        assert_eq!(resolved.origin("faces"), Some(&Origin::BuiltIn));
        assert_eq!(resolved.origin("quality"), Some(&Origin::BuiltIn));
        assert_eq!(resolved.origin("views"), Some(&Origin::Preset(Quality::Standard)));
        assert_eq!(resolved.origin("nothing"), None);
    }

    #[test]
    fn settings_survive_as_a_text() {
        let set = [
            ("faces", "200,1000"),
            ("quality", "draft"),
            ("texture_size", "256,512"),
            ("scope", "objects"),
            ("objects", "Tree*"),
        ];
        let resolved = resolve(vec![layer(Origin::CommandLine, &set)]).expect("valid").settings;
        for settings in [BakeSettings::default(), BakeSettings::preset(Quality::Best), resolved] {
            assert_eq!(BakeSettings::from_ron(&settings.to_ron()).expect("valid"), settings, "{}", settings.to_ron());
        }
    }

    #[test]
    fn levels_without_their_source_have_materials_of_their_own() {
        for (source, expected) in
            [("keep", LevelMaterials::Auto), ("drop", LevelMaterials::Baked), ("on-demand", LevelMaterials::Baked)]
        {
            let resolved = resolve(vec![layer(project(), &[("source", source)])]).expect("valid");
            assert_eq!(resolved.settings.materials, expected);
        }
    }

    #[test]
    fn later_layers_win_field_by_field() {
        let layers = vec![
            layer(project(), &[("views", "64"), ("gutter", "2")]),
            layer(Origin::CommandLine, &[("views", "100")]),
        ];
        let resolved = resolve(layers).expect("valid");
        assert_eq!((resolved.settings.views, resolved.settings.gutter), (100, 2));
        assert_eq!(resolved.origin("views"), Some(&Origin::CommandLine));
        assert_eq!(resolved.origin("gutter"), Some(&project()));
    }

    #[test]
    fn explicit_fields_win_over_a_quality_from_any_layer() {
        let layers = vec![layer(project(), &[("views", "64")]), layer(Origin::CommandLine, &[("quality", "best")])];
        let resolved = resolve(layers).expect("valid");
        assert_eq!((resolved.settings.views, resolved.settings.refine_steps), (64, 800));
        assert_eq!(resolved.settings.quality, Quality::Best);
        assert_eq!(resolved.origin("quality"), Some(&Origin::CommandLine));
        assert_eq!(resolved.origin("refine_steps"), Some(&Origin::Preset(Quality::Best)));
    }

    #[test]
    fn budgets_are_sorted_and_distinct() {
        let resolved = resolve(vec![layer(Origin::CommandLine, &[("faces", "4000,500,4000")])]).expect("valid");
        assert_eq!(resolved.settings.faces, [500, 4000]);
    }

    #[test]
    fn overrides_made_in_code_are_checked() {
        let overrides = BakeOverrides { gutter: Some(99), ..BakeOverrides::default() };
        let error = resolve(vec![Layer { origin: project(), overrides }]).expect_err("out of range");
        assert_eq!(
            error.to_string(),
            "settings: gutter: 99 is out of range: expected a whole number from 1 to 16; the nearest is 16"
        );
    }
}
