//! `simpliguard settings`: the reference, and the settings of a model. Both print RON that can be read back.

use simpliguard::settings::{Resolved, reference};

use crate::args::{SettingsArgs, SettingsCommand};
use crate::error::UsageError;
use crate::output::write_stdout;
use crate::project::SettingsLookup;

pub(crate) fn run(args: &SettingsArgs) -> Result<(), UsageError> {
    let text = match &args.command {
        None => reference_text(),
        Some(SettingsCommand::Show { asset, settings }) => {
            effective_text(&SettingsLookup::new(settings)?.of(asset)?.resolved?)
        }
    };
    write_stdout(&text)
}

fn reference_text() -> String {
    let mut text = String::from("(\n");
    for field in reference() {
        let [draft, standard, best] = &field.defaults;
        text += &format!("    // {}\n    // {}", field.doc, field.accepts);
        if field.is_preset() {
            text += &format!("; by quality: Draft {draft}, Standard {standard}, Best {best}");
        }
        text += &format!("\n    {}: {standard},\n", field.name);
    }
    text + ")\n"
}

fn effective_text(resolved: &Resolved) -> String {
    let lines: Vec<_> = resolved.effective().map(|e| (format!("{}: {},", e.name, e.value), e.origin)).collect();
    let width = lines.iter().map(|(setting, _)| setting.len()).max().unwrap_or(0);
    let lines = lines.iter().map(|(setting, origin)| format!("    {setting:width$} // {origin}\n"));
    format!("(\n{})\n", lines.collect::<String>())
}
