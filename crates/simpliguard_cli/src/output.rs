//! Standard output, and files.

use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;
use simpliguard::Printable;
use simpliguard_cache::can_write_in;

use crate::console::printable_lines;
use crate::error::UsageError;

/// A JSON document as text.
pub(crate) fn json_text(document: &impl Serialize) -> Result<String, UsageError> {
    let text = serde_json::to_string_pretty(document);
    let text = text.map_err(|e| UsageError(format!("cannot write the JSON document: {e}")))?;
    Ok(escape_strings(&text) + "\n")
}

/// Escapes the characters of a JSON text that JSON allows but that steer a terminal. They stand in strings only.
fn escape_strings(json: &str) -> String {
    let escape = |c: char| match c {
        c if c != '\n' && Printable::is_escaped(c) => format!("\\u{:04x}", u32::from(c)),
        c => c.to_string(),
    };
    if json.contains(Printable::is_escaped) { json.chars().map(escape).collect() } else { json.to_owned() }
}

/// Writes a text to standard output.
pub(crate) fn write_stdout(text: &str) -> Result<(), UsageError> {
    match io::stdout().write_all(printable_lines(text).as_bytes()) {
        // The reader of a pipe may leave early.
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(UsageError(format!("cannot write to stdout: {e}"))),
        _ => Ok(()),
    }
}

/// Checks that a file can be created: in the nearest existing folder above it. Leaves nothing behind.
pub(crate) fn can_create(file: &Path) -> io::Result<()> {
    let there = file.ancestors().skip(1).find(|folder| folder.exists());
    can_write_in(there.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")))
}

/// Lines of cells in columns as wide as their longest cell. The first `left` columns are aligned to the left, and the
/// last column too if `text_last`; the others are aligned to the right.
pub(crate) fn columns(rows: &[Vec<String>], left: usize, text_last: bool) -> String {
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|c| c.chars().count()).max();
    let widths: Vec<usize> = (0..count).map(|column| width(column).unwrap_or(0)).collect();
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
            let is_left = column < left || text_last && column + 1 == count;
            if is_left { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        text += cells.collect::<Vec<_>>().join("  ").trim_end();
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_no_character_that_steers_a_terminal() {
        let names = ["\x1b[2J", "\u{9b}2J\u{7f}", "\u{202e}\u{2028}", "f\u{fc}chse\n"];
        let text = json_text(&names).expect("serialises");
        assert!(!text.replace('\n', "").contains(Printable::is_escaped), "{text:?}");
        assert_eq!(serde_json::from_str::<Vec<String>>(&text).expect("JSON"), names);
    }
}
