//! The result of a bake, and its form in the cache.

use std::panic::{AssertUnwindSafe, catch_unwind};

use simpliguard::data::{Level, Model};
use simpliguard::gltf::{check_binary, compress_textures, export_level};
use simpliguard::settings::BakeSettings;
use simpliguard::{Context, Error, Report, Source, StageId, Status};
use simpliguard_cache::{Check, Entry};

const COMBINED: &str = "combined.glb";
const REPORT: &str = "report.json";
const SHEET: &str = "sheet.png";
const LEVEL_PREFIX: &str = "level_";
const LEVEL_SUFFIX: &str = ".glb";

/// The first bytes of every PNG.
const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// The result of a bake: all files that can be written without baking again.
#[derive(Clone, Debug)]
pub struct BakeResult {
    /// Source and levels in one binary glTF.
    pub combined: Vec<u8>,
    /// Each level as a binary glTF of its own, with its budget in triangles. Empty if they were not asked for.
    pub levels: Vec<(u32, Vec<u8>)>,
    /// Contact sheet as PNG, if one was made and asked for.
    pub sheet: Option<Vec<u8>>,
    /// Report of the bake. Its seconds are not stored, so equal bakes are equal in the cache.
    pub report: Report,
}

/// Draws the levels of a model beside it, as PNG.
pub type DrawSheet<'a> = &'a (dyn Fn(&Model, &[Level]) -> Result<Vec<u8>, Error> + Sync);

/// The parts of a result that a caller needs. A bake stores all levels in any case.
#[derive(Clone, Copy)]
pub enum Parts<'a> {
    /// The combined file and the report.
    Combined,
    /// Also the levels.
    Levels,
    /// Also the contact sheet, which this function draws. It is made together with the levels only, so a stored result
    /// without a sheet does not suffice.
    Sheet(DrawSheet<'a>),
}

impl<'a> Parts<'a> {
    /// Tells whether an object has to be read.
    pub(crate) fn include(self, object: &str) -> bool {
        match self {
            Self::Combined => object == COMBINED || object == REPORT,
            Self::Levels => object != SHEET,
            Self::Sheet(_) => true,
        }
    }

    /// Tells whether a stored result has all parts.
    pub(crate) fn are_in(self, result: &BakeResult) -> bool {
        !matches!(self, Self::Sheet(_)) || result.sheet.is_some() || result.levels.is_empty()
    }

    /// The check of a result that somebody else has stored: it is the result of a bake, and tells whether it has all parts.
    pub(crate) fn check(self) -> Check {
        match self {
            Self::Combined | Self::Levels => |entry| BakeResult::check(entry).map(|()| true),
            Self::Sheet(_) => |entry| BakeResult::check(entry).map(|()| has_sheet(entry)),
        }
    }

    fn sheet(self) -> Option<DrawSheet<'a>> {
        if let Self::Sheet(draw) = self { Some(draw) } else { None }
    }
}

impl BakeResult {
    /// Runs the pipeline on the rayon pool of the caller.
    ///
    /// # Errors
    /// Those of the pipeline. A panic in it is a bug. It fails this model alone, as [`Error::Invalid`].
    pub fn compute(
        source: &Source<'_>,
        settings: &BakeSettings,
        context: &Context<'_>,
        parts: Parts<'_>,
    ) -> Result<Self, Error> {
        catch_panics(source.name, || run_pipeline(source, settings, context, parts.sheet()))
    }

    /// With the textures of the combined file in blocks, if it has levels.
    ///
    /// # Errors
    /// Those of [`compress_textures`].
    pub(crate) fn in_blocks(self, asset: &str, context: &Context<'_>) -> Result<Self, Error> {
        match self.report.status {
            Status::Baked | Status::KeptLods => {}
            Status::SmallEnough | Status::PassThrough => return Ok(self),
        }
        let compress = || compress_textures(asset, &self.combined, &context.cancellation);
        Ok(Self { combined: catch_panics(asset, compress)?, ..self })
    }

    /// The form in the cache.
    ///
    /// # Errors
    /// If the report cannot be written as JSON.
    pub fn to_entry(&self) -> Result<Entry, serde_json::Error> {
        let report = Report { seconds: Vec::new(), ..self.report.clone() };
        let mut objects = vec![
            (COMBINED.to_owned(), self.combined.clone()),
            (REPORT.to_owned(), serde_json::to_vec_pretty(&report)?),
        ];
        let name = |budget| format!("{LEVEL_PREFIX}{budget}{LEVEL_SUFFIX}");
        objects.extend(self.levels.iter().map(|(budget, glb)| (name(budget), glb.clone())));
        objects.extend(self.sheet.iter().map(|png| (SHEET.to_owned(), png.clone())));
        Ok(Entry { objects })
    }

    /// Checks that an entry which somebody else has stored is the result of a bake. Its hashes say only that it is whole.
    ///
    /// # Errors
    /// A description of what the entry is instead.
    pub fn check(entry: &Entry) -> Result<(), String> {
        let failed = |name: &str, found: String| Err(format!("is not the result of a bake: {name}: {found}"));
        for name in [COMBINED, REPORT] {
            if entry.object(name).is_none() {
                return failed(name, "it is missing".into());
            }
        }
        for (name, bytes) in &entry.objects {
            if let Err(found) = check_object(name, bytes) {
                return failed(name, found);
            }
        }
        Ok(())
    }

    /// The result in an entry of the cache. `None` if the entry is not the result of a bake.
    pub fn from_entry(entry: Entry) -> Option<Self> {
        let (mut combined, mut report, mut sheet, mut levels) = (None, None, None, Vec::new());
        for (name, bytes) in entry.objects {
            match name.as_str() {
                COMBINED => combined = Some(bytes),
                REPORT => report = serde_json::from_slice(&bytes).ok(),
                SHEET => sheet = Some(bytes),
                name => levels.push((budget_of(name)?, bytes)),
            }
        }
        Some(Self { combined: combined?, report: report?, levels, sheet })
    }
}

/// Tells whether an entry has a sheet or, without levels, needs none.
fn has_sheet(entry: &Entry) -> bool {
    entry.object(SHEET).is_some() || entry.objects.iter().all(|(name, _)| budget_of(name).is_none())
}

/// The budget in the name of a level; `None` for any other name.
fn budget_of(name: &str) -> Option<u32> {
    name.strip_prefix(LEVEL_PREFIX)?.strip_suffix(LEVEL_SUFFIX)?.parse().ok()
}

/// Runs a part of the pipeline. A panic in it is a bug; it becomes [`Error::Invalid`].
pub(crate) fn catch_panics<T>(asset: &str, work: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        let found = format!("internal error: {text}");
        Err(Error::invalid(asset, StageId::Export, found, "this is a bug; please report it with the file"))
    })
}

fn check_object(name: &str, bytes: &[u8]) -> Result<(), String> {
    match name {
        REPORT => serde_json::from_slice(bytes).map(|_: Report| ()).map_err(|e| format!("it is no report: {e}")),
        SHEET if bytes.starts_with(PNG_SIGNATURE) => Ok(()),
        SHEET => Err("it is no PNG".into()),
        name if name == COMBINED || budget_of(name).is_some() => check_binary(bytes),
        _ => Err("no bake has an object of this name".into()),
    }
}

fn run_pipeline(
    source: &Source<'_>,
    settings: &BakeSettings,
    context: &Context<'_>,
    draw: Option<DrawSheet<'_>>,
) -> Result<BakeResult, Error> {
    let baked = simpliguard::bake(source, settings, context)?;
    let (mut levels, mut sheet) = (Vec::with_capacity(baked.levels.len()), None);
    if let Some(model) = &baked.model {
        for level in &baked.levels {
            context.check(source.name)?;
            levels.push((level.budget, export_level(model, level)?));
        }
        if let (Some(draw), false) = (draw, levels.is_empty()) {
            sheet = Some(draw(model, &baked.levels)?);
        }
    }
    Ok(BakeResult { combined: baked.glb, levels, sheet, report: baked.report })
}

#[cfg(test)]
mod tests {
    use simpliguard::gltf::binary;

    use super::*;

    fn result() -> BakeResult {
        let report = Report {
            status: Status::Baked,
            source_faces: 9,
            levels: Vec::new(),
            objects: Vec::new(),
            notes: vec!["a note".into()],
            seconds: vec![("simplify".into(), 1.5)],
        };
        let levels = vec![(1000, vec![1]), (2000, vec![2])];
        BakeResult { combined: vec![0], levels, sheet: Some(vec![3]), report }
    }

    #[test]
    fn a_result_survives_storage_but_for_its_times() {
        let result = result();
        let entry = result.to_entry().expect("serialises");
        let found = BakeResult::from_entry(entry.clone()).expect("a bake");
        assert_eq!((&found.combined, &found.levels, &found.sheet), (&result.combined, &result.levels, &result.sheet));
        assert_eq!(found.report, Report { seconds: Vec::new(), ..result.report });
        let mut partial = entry;
        partial.objects.retain(|(name, _)| name != REPORT);
        assert!(BakeResult::from_entry(partial).is_none());
    }

    /// An entry that a bake might have stored.
    fn honest() -> Entry {
        let glb = binary(&serde_json::json!({"asset": {"version": "2.0"}}), &[]).expect("a small file");
        let sheet = Some([PNG_SIGNATURE, b"..."].concat());
        let honest = BakeResult { combined: glb.clone(), levels: vec![(9, glb)], sheet, ..result() };
        honest.to_entry().expect("serialises")
    }

    #[test]
    fn entries_that_are_no_result_are_told_from_results() {
        let honest = honest();
        assert_eq!(BakeResult::check(&honest), Ok(()));
        for name in [COMBINED, REPORT, SHEET, "level_9.glb"] {
            let mut forged = honest.clone();
            forged
                .objects
                .iter_mut()
                .filter(|(object, _)| object == name)
                .for_each(|(_, bytes)| *bytes = b"{}".to_vec());
            let found = BakeResult::check(&forged).expect_err(name);
            assert!(found.contains(name), "{found}");
        }
        for name in [COMBINED, REPORT] {
            let mut partial = honest.clone();
            partial.objects.retain(|(object, _)| object != name);
            assert!(BakeResult::check(&partial).expect_err(name).contains("it is missing"));
        }
        for name in ["level_9.exe", "level_x.glb", "run.sh"] {
            let mut more = honest.clone();
            more.objects.push((name.to_owned(), Vec::new()));
            assert!(BakeResult::check(&more).expect_err(name).contains(name));
        }
    }

    #[test]
    fn a_sheet_is_missing_only_where_one_was_asked_for() {
        let draw = |_: &Model, _: &[Level]| Ok(Vec::new());
        let without = BakeResult { sheet: None, ..result() };
        assert!(Parts::Levels.are_in(&without) && !Parts::Sheet(&draw).are_in(&without));
        assert!(Parts::Sheet(&draw).are_in(&result()));
        let checks = |entry: Entry| [Parts::Levels, Parts::Sheet(&draw)].map(|parts| parts.check()(&entry));
        assert_eq!(checks(honest()), [Ok(true), Ok(true)]);
        let mut entry = honest();
        entry.objects.retain(|(name, _)| name != SHEET);
        assert_eq!(checks(entry), [Ok(true), Ok(false)]);
        // A model without levels has no sheet either.
        assert!(Parts::Sheet(&draw).are_in(&BakeResult { levels: Vec::new(), ..without }));
        let read = |parts: Parts<'_>| [COMBINED, REPORT, "level_9.glb", SHEET].map(|object| parts.include(object));
        assert_eq!(read(Parts::Combined), [true, true, false, false]);
        assert_eq!(read(Parts::Levels), [true, true, true, false]);
        assert_eq!(read(Parts::Sheet(&draw)), [true; 4]);
    }
}
