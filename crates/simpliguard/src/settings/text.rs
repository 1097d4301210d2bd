//! RON with messages that say file, line, column, and the nearest valid name.

use ron::error::SpannedError;
use serde::de::DeserializeOwned;

use super::BakeOverrides;
use crate::Error;

/// Reads a RON text of overrides, such as `(faces: [500], quality: Draft)`. `file` is for the message.
pub fn parse_overrides(text: &str, file: &str) -> Result<BakeOverrides, Error> {
    parse(text, file)
}

/// Reads any RON text. `file` is for the message.
pub(super) fn parse<T: DeserializeOwned>(text: &str, file: &str) -> Result<T, Error> {
    ron::from_str(text).map_err(|error| Error::Settings(describe(&error, file)))
}

fn describe(error: &SpannedError, file: &str) -> String {
    let at = error.span.start;
    let what = match &error.code {
        ron::Error::NoSuchStructField { expected, found, .. } => {
            format!("unknown field '{found}'{}", did_you_mean(found, expected))
        }
        ron::Error::NoSuchEnumVariant { expected, found, .. } => {
            format!("unknown value '{found}'{}", did_you_mean(found, expected))
        }
        ron::Error::DuplicateStructField { field, .. } => format!("'{field}' is set twice"),
        ron::Error::MissingStructField { field, .. } => format!("'{field}' is missing"),
        code => code.to_string(),
    };
    format!("{file}:{}:{}: {what}", at.line, at.col)
}

/// "; did you mean 'x'?", or all names if none is near.
pub(super) fn did_you_mean(found: &str, expected: &[&str]) -> String {
    let near = |name: &&&str| strsim::damerau_levenshtein(found, name);
    match expected.iter().min_by_key(near) {
        Some(name) if near(&name) <= found.len().max(name.len()) / 2 => format!("; did you mean '{name}'?"),
        _ => format!("; known are: {}", expected.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Quality, Resolution};

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
            "settings: a.ron:3:19: texture_size: 1000 is out of range: expected a power of two from 64 to 4096; the \
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
