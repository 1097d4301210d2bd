//! Bevy's `.meta` files, as written beside a source asset (format of Bevy 0.19).
//!
//! ```ron
//! (
//!     meta_format_version: "1.0",
//!     asset: Process(
//!         processor: "SimpliguardProcess",
//!         settings: (faces: [500, 1000]),
//!     ),
//! )
//! ```

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::fields::BakeOverrides;
use super::text::parse;
use crate::Error;

/// The overrides of a `.meta` file; `None` if it names another processor, loads the asset unprocessed, or ignores it.
/// `file` is for messages.
///
/// # Errors
/// If the text is malformed, or names a field or a value that does not exist.
pub fn parse_meta(text: &str, file: &str) -> Result<Option<BakeOverrides>, Error> {
    // First without the settings: their fields depend on the processor.
    let AnyMeta { asset } = parse(text, file)?;
    match asset {
        AnyAction::Process { processor } if is_ours(&processor) => {
            let OurMeta { asset: OurAction::Process { settings, .. }, .. } = parse(text, file)?;
            Ok(Some(settings))
        }
        _ => Ok(None),
    }
}

/// True for the short type path of our processor, and for a full path in our crate.
fn is_ours(processor: &str) -> bool {
    let (krate, name) = processor.split_once("::").map_or(("bevy_simpliguard", processor), |(krate, rest)| {
        (krate, rest.rsplit_once("::").map_or(rest, |(_, name)| name))
    });
    krate == "bevy_simpliguard" && name == "SimpliguardProcess"
}

#[derive(Deserialize)]
#[serde(rename = "AssetMeta")]
struct AnyMeta {
    asset: AnyAction,
}

#[derive(Deserialize)]
#[serde(rename = "AssetAction")]
enum AnyAction {
    Load {},
    Process { processor: String },
    Ignore,
}

#[derive(Deserialize)]
#[serde(rename = "AssetMeta", deny_unknown_fields)]
struct OurMeta {
    #[serde(rename = "meta_format_version")]
    _version: String,
    #[serde(default, rename = "processed_info")]
    _processed_info: IgnoredAny,
    asset: OurAction,
}

#[derive(Deserialize)]
#[serde(rename = "AssetAction", deny_unknown_fields)]
enum OurAction {
    Process {
        #[serde(rename = "processor")]
        _processor: IgnoredAny,
        settings: BakeOverrides,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn process(processor: &str, settings: &str) -> String {
        format!(
            "(\n    meta_format_version: \"1.0\",\n    asset: Process(\n        processor: \"{processor}\",\n        \
             settings: {settings},\n    ),\n)"
        )
    }

    #[test]
    fn our_settings_are_read() {
        for name in [
            "SimpliguardProcess",
            "bevy_simpliguard::SimpliguardProcess",
            "bevy_simpliguard::process::SimpliguardProcess",
        ] {
            let overrides = parse_meta(&process(name, "(faces: [700])"), "a.glb.meta").expect(name).expect(name);
            assert_eq!(overrides.faces, Some(vec![700]));
        }
    }

    #[test]
    fn other_actions_and_processors_are_left_alone() {
        let load =
            "(meta_format_version: \"1.0\", asset: Load(loader: \"bevy_gltf::loader::GltfLoader\", settings: (x: 1)))";
        let ignore = "(meta_format_version: \"1.0\", asset: Ignore)";
        let other = process("other::SimpliguardProcess", "(unknown: [1, (a: 2)])");
        for text in [load, ignore, &other] {
            assert_eq!(parse_meta(text, "a.glb.meta").expect(text), None);
        }
    }

    #[test]
    fn a_typo_is_located() {
        let message = parse_meta(&process("SimpliguardProcess", "(face: [1])"), "a.glb.meta").expect_err("typo");
        assert_eq!(message.to_string(), "settings: a.glb.meta:5:20: unknown field 'face'; did you mean 'faces'?");
    }

    #[test]
    fn missing_settings_are_an_error_as_in_bevy() {
        let text = "(meta_format_version: \"1.0\", asset: Process(processor: \"SimpliguardProcess\"))";
        assert!(parse_meta(text, "a").expect_err("no settings").to_string().contains("'settings' is missing"));
    }
}
