//! Reads overrides from RON.

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};

use super::fields::{BakeOverrides, NAMES};
use super::text::parse;
use crate::Error;

/// Reads a RON text of overrides, such as `(faces: [500], quality: Draft)`. `file` is for the message.
///
/// # Errors
/// If the text is malformed, or names a field or a value that does not exist.
pub fn parse_overrides(text: &str, file: &str) -> Result<BakeOverrides, Error> {
    parse(text, file)
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

/// The name of an existing field.
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
    use crate::settings::choices::{Quality, Resolution};

    fn message(text: &str) -> String {
        parse_overrides(text, "a.ron").expect_err(text).to_string()
    }

    #[test]
    fn overrides_need_no_some() {
        let o = parse_overrides("(faces: [500, 250], quality: Draft, resolution: Cells(64))", "a").expect("valid");
        assert_eq!(o.faces, Some(vec![500, 250]));
        assert_eq!(o.quality, Some(Quality::Draft));
        assert_eq!(o.resolution, Some(Resolution::Cells(64)));
        assert_eq!(o.views, None);
        assert_eq!(parse_overrides("()", "a").expect("empty"), BakeOverrides::default());
    }

    #[test]
    fn overrides_survive_a_round_trip() {
        let o = parse_overrides("(faces: [500], curvature: 0.25, watertight: true)", "a").expect("valid");
        let text = ron::to_string(&o).expect("serialises");
        assert_eq!(text, "(faces:[500],curvature:0.25,watertight:true)");
        assert_eq!(parse_overrides(&text, "a").expect("round trip"), o);
    }

    #[test]
    fn messages_say_where_and_what() {
        assert_eq!(
            message("(\n    facs: [500],\n)"),
            "settings: a.ron:2:5: unknown field 'facs'; did you mean 'faces'?"
        );
        assert_eq!(
            message("(\n    views: 48,\n    texture_size: 1000,\n)"),
            "settings: a.ron:3:23: texture_size: 1000 is out of range: expected a power of two from 64 to 4096, a list of 1 to 8 of \
             them, or Auto; the \
             nearest is 1024"
        );
        assert_eq!(message("(views: 8, views: 9)"), "settings: a.ron:1:12: 'views' is set twice");
        assert_eq!(
            message("(views: true)"),
            "settings: a.ron:1:8: views: expected a whole number from 8 to 256 (Expected integer)"
        );
        assert!(message("(quality: Drft)").contains("quality: expected Draft, Standard or Best (Unexpected variant"));
        assert!(message("(views: 8").starts_with("settings: a.ron:1:"));
        assert!(message("(zzzzzzzzzzz: 1)").contains("known are: enabled, faces"));
    }
}
