//! The README says what the code does.

use simpliguard::settings::{FieldInfo, reference};

const README: &str = include_str!("../../README.md");

/// A row of the table of settings.
fn row(field: &FieldInfo) -> String {
    let [draft, standard, best] = &field.defaults;
    let default =
        if field.is_preset() { format!("`{draft}` / `{standard}` / `{best}`") } else { format!("`{standard}`") };
    format!("| `{}` | {default} | {} | {} |", field.name, field.accepts, field.doc)
}

#[test]
fn the_table_of_settings_is_complete_and_current() {
    let table: Vec<String> = reference().iter().map(row).collect();
    let missing = table.iter().any(|row| !README.lines().any(|line| line == row));
    assert!(!missing, "the README's table of settings should read:\n{}", table.join("\n"));
}
