//! Reads RON. Messages name the file, line and column, and the nearest valid name.

use ron::error::SpannedError;
use serde::de::DeserializeOwned;

use crate::Error;

/// Byte order mark that editors on Windows put in front of a text.
const BOM: char = '\u{feff}';

/// Reads a RON text. `file` is for the message.
pub(super) fn parse<T: DeserializeOwned>(text: &str, file: &str) -> Result<T, Error> {
    ron::from_str(text.strip_prefix(BOM).unwrap_or(text)).map_err(|error| Error::Settings(describe(&error, file)))
}

fn describe(error: &SpannedError, file: &str) -> String {
    let at = error.span.start;
    let mistake = match &error.code {
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
    format!("{file}:{}:{}: {mistake}", at.line, at.col)
}

/// The end of a message: "; did you mean 'x'?", or all names if none is near.
pub(super) fn did_you_mean(found: &str, expected: &[&str]) -> String {
    let near = |name: &&&str| strsim::damerau_levenshtein(found, name);
    match expected.iter().min_by_key(near) {
        Some(name) if near(&name) <= found.len().max(name.len()) / 2 => format!("; did you mean '{name}'?"),
        _ => format!("; known are: {}", expected.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use crate::settings::{ProjectFile, parse_meta, parse_overrides};

    #[test]
    fn a_byte_order_mark_is_no_part_of_the_text() {
        let overrides = parse_overrides("\u{feff}(faces: [500])", "a.ron").expect("valid");
        assert_eq!(overrides.faces, Some(vec![500]));
        let message = parse_overrides("\u{feff}(facs: [500])", "a.ron").expect_err("a typo").to_string();
        assert!(message.starts_with("settings: a.ron:1:2: "), "{message}");
        assert!(ProjectFile::parse("\u{feff}(defaults: ())", "p.ron").is_ok());
    }

    #[test]
    fn deep_nesting_is_an_error() {
        for depth in [128, 260, 10_000] {
            for (open, close) in [("[", "]"), ("(", ")"), ("(a:", ")"), ("{1:", "}"), ("Some(", ")"), ("X(", ")")] {
                let nested = format!("{}{}", open.repeat(depth), close.repeat(depth));
                let meta = format!(
                    "(meta_format_version: \"1.0\", asset: Process(processor: \"SimpliguardProcess\", settings: {nested}))"
                );
                assert!(parse_overrides(&nested, "a.ron").is_err(), "{depth} {open}");
                assert!(parse_overrides(&format!("(faces: {nested})"), "a.ron").is_err(), "{depth} {open}");
                assert!(ProjectFile::parse(&format!("(defaults: {nested})"), "a.ron").is_err(), "{depth} {open}");
                assert!(parse_meta(&meta, "a.ron").is_err(), "{depth} {open}");
            }
        }
    }
}
