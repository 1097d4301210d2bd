//! Reads RON. Messages name the file, line and column, and the nearest valid name.

use ron::error::SpannedError;
use serde::de::DeserializeOwned;

use crate::Error;

/// Reads a RON text. `file` is for the message.
pub(super) fn parse<T: DeserializeOwned>(text: &str, file: &str) -> Result<T, Error> {
    ron::from_str(text).map_err(|error| Error::Settings(describe(&error, file)))
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
