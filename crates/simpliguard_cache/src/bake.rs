//! Bakes in the cache: which key a bake has, and what is stored of it. Shared by everything that bakes, so that one
//! finds what another has made.

use std::panic::{AssertUnwindSafe, catch_unwind};

use simpliguard::data::{Level, Model};
use simpliguard::gltf::{export_level, external_uris};
use simpliguard::settings::BakeSettings;
use simpliguard::{Context, Error, PIPELINE_VERSION, Report, Source, StageId};

use crate::{Entry, Key, KeyBuilder};

const COMBINED: &str = "combined.glb";
const REPORT: &str = "report.json";
const SHEET: &str = "sheet.png";
const LEVEL_PREFIX: &str = "level_";
const LEVEL_SUFFIX: &str = ".glb";

/// The key of a bake: over the chain's version, the content of all files of the source, and the settings. Reads the
/// external files of a glTF, but imports nothing.
///
/// # Errors
/// [`Error::Invalid`] if the source is no glTF.
pub fn bake_key(source: &Source<'_>, settings: &BakeSettings) -> Result<Key, Error> {
    let mut key = KeyBuilder::new(PIPELINE_VERSION).input(source.bytes);
    for uri in external_uris(source.name, source.bytes)? {
        key = match source.resources.read(&uri) {
            Ok(bytes) => key.input(&bytes),
            Err(_) => key.missing_input(),
        };
    }
    Ok(key.settings(&settings.canonical_bake()).finish())
}

/// Everything that can be written out of a bake without baking again.
#[derive(Clone, Debug)]
pub struct BakeResult {
    /// Source and levels in one binary glTF.
    pub combined: Vec<u8>,
    /// Each level as a binary glTF of its own, with its budget in triangles.
    pub levels: Vec<(u32, Vec<u8>)>,
    /// Contact sheet as PNG, if one was made.
    pub sheet: Option<Vec<u8>>,
    /// How the bake went. Its times are not stored: equal bakes are equal in the cache.
    pub report: Report,
}

/// Draws the levels of a model beside it, as PNG.
pub type Draw<'a> = &'a (dyn Fn(&Model, &[Level]) -> Result<Vec<u8>, Error> + Sync);

impl BakeResult {
    /// Whether an object is part of every result: not of single levels or of a sheet.
    pub fn is_whole(object: &str) -> bool {
        object == COMBINED || object == REPORT
    }

    /// Runs the chain on the rayon pool of the caller. With `sheet`, a contact sheet is made of models that get levels.
    ///
    /// # Errors
    /// Those of the chain. A panic in it is a bug and fails this model alone, as [`Error::Invalid`].
    pub fn compute(
        source: &Source<'_>,
        settings: &BakeSettings,
        context: &Context<'_>,
        sheet: Option<Draw<'_>>,
    ) -> Result<Self, Error> {
        let chain = || run_chain(source, settings, context, sheet);
        catch_unwind(AssertUnwindSafe(chain)).unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            let found = format!("internal error: {text}");
            Err(Error::invalid(source.name, StageId::Export, found, "this is a bug; please report it with the file"))
        })
    }

    /// As it is stored. `made_by` says what computed it, such as `cpu`.
    pub fn to_entry(&self, made_by: &str) -> Result<Entry, serde_json::Error> {
        let report = Report { seconds: Vec::new(), ..self.report.clone() };
        let mut objects = vec![
            (COMBINED.to_owned(), self.combined.clone()),
            (REPORT.to_owned(), serde_json::to_vec_pretty(&report)?),
        ];
        let name = |budget| format!("{LEVEL_PREFIX}{budget}{LEVEL_SUFFIX}");
        objects.extend(self.levels.iter().map(|(budget, glb)| (name(budget), glb.clone())));
        objects.extend(self.sheet.iter().map(|png| (SHEET.to_owned(), png.clone())));
        Ok(Entry { made_by: made_by.to_owned(), objects })
    }

    /// From what was stored; `None` if it is no bake.
    pub fn from_entry(entry: Entry) -> Option<Self> {
        let (mut combined, mut report, mut sheet, mut levels) = (None, None, None, Vec::new());
        for (name, bytes) in entry.objects {
            match name.as_str() {
                COMBINED => combined = Some(bytes),
                REPORT => report = serde_json::from_slice(&bytes).ok(),
                SHEET => sheet = Some(bytes),
                name => {
                    let budget = name.strip_prefix(LEVEL_PREFIX)?.strip_suffix(LEVEL_SUFFIX)?.parse().ok()?;
                    levels.push((budget, bytes));
                }
            }
        }
        Some(Self { combined: combined?, report: report?, levels, sheet })
    }
}

fn run_chain(
    source: &Source<'_>,
    settings: &BakeSettings,
    context: &Context<'_>,
    sheet: Option<Draw<'_>>,
) -> Result<BakeResult, Error> {
    let baked = simpliguard::bake(source, settings, context)?;
    let (mut levels, mut picture) = (Vec::with_capacity(baked.levels.len()), None);
    if let Some(model) = &baked.model {
        for level in &baked.levels {
            context.check(source.name)?;
            levels.push((level.budget, export_level(model, level)?));
        }
        if let (Some(draw), false) = (sheet, levels.is_empty()) {
            picture = Some(draw(model, &baked.levels)?);
        }
    }
    Ok(BakeResult { combined: baked.glb, levels, sheet: picture, report: baked.report })
}

#[cfg(test)]
mod tests {
    use simpliguard::{NoResources, RelativeUri, Resources, Status};

    use super::*;

    const GLTF: &[u8] = br#"{"asset":{"version":"2.0"},"buffers":[{"uri":"a.bin","byteLength":4}]}"#;

    struct OneFile(&'static [u8]);

    impl Resources for OneFile {
        fn read(&self, uri: &RelativeUri) -> Result<bytes::Bytes, String> {
            if uri.as_str() == "a.bin" { Ok(bytes::Bytes::from_static(self.0)) } else { Err("none".into()) }
        }
    }

    fn key(name: &str, resources: &dyn Resources, settings: &BakeSettings) -> Key {
        bake_key(&Source { name, bytes: GLTF, resources }, settings).expect("a glTF")
    }

    #[test]
    fn the_key_follows_external_files_and_settings_but_no_name() {
        let settings = BakeSettings::default();
        let base = key("a.gltf", &OneFile(b"1234"), &settings);
        assert_eq!(base, key("elsewhere/b.gltf", &OneFile(b"1234"), &settings));
        assert_ne!(base, key("a.gltf", &OneFile(b"1235"), &settings));
        assert_ne!(base, key("a.gltf", &NoResources, &settings));
        let changed = BakeSettings { gutter: 2, ..settings };
        assert_ne!(base, key("a.gltf", &OneFile(b"1234"), &changed));
    }

    #[test]
    fn a_result_survives_storage_but_for_its_times() {
        let report = Report {
            status: Status::Baked,
            source_faces: 9,
            levels: Vec::new(),
            notes: vec!["a note".into()],
            seconds: vec![("shape".into(), 1.5)],
        };
        let levels = vec![(1000, vec![1]), (2000, vec![2])];
        let result = BakeResult { combined: vec![0], levels, sheet: Some(vec![3]), report };
        let entry = result.to_entry("cpu").expect("serialises");
        let found = BakeResult::from_entry(entry.clone()).expect("a bake");
        assert_eq!((&found.combined, &found.levels, &found.sheet), (&result.combined, &result.levels, &result.sheet));
        assert_eq!(found.report, Report { seconds: Vec::new(), ..result.report });
        let mut partial = entry;
        partial.objects.retain(|(name, _)| name != REPORT);
        assert!(BakeResult::from_entry(partial).is_none());
    }
}
