//! The bake of a scene file object by object: `scope: Objects`.
//!
//! The caller bakes each object that [`SceneBake::next_object`] returns, in any way it likes: a cache finds most of them.
//! Only one object and the scene's own bytes are in memory at a time.

use std::collections::HashMap;

use simpliguard_key::{Key, KeyBuilder};

use super::baked::Baked;
use super::context::{Context, Progress, ProgressSink};
use super::own_levels;
use super::report::{LevelReport, ObjectReport, OwnLevelReport, Report, StageSeconds, Status};
use super::version::PIPELINE_VERSION;
use crate::gltf::{ImportLimits, ObjectScene};
use crate::settings::{
    AtlasSize, BakeSettings, Candidates, ExistingLods, LevelMaterials, MatchingRules, RuleMatcher, Scope,
    SourceGeometry,
};
use crate::{Error, NoResources, Source};

/// Fewest triangles of a level of an object: those of a box.
const FEWEST: u64 = 12;

/// A scene file whose objects are being baked.
pub struct SceneBake {
    scene: ObjectScene,
    asset: String,
    settings: BakeSettings,
    /// True if objects keep the levels that they came with.
    keeps_levels: bool,
    /// Number of the next kind of objects.
    next: usize,
    /// The kinds whose files were built, by the hash of the file and the settings.
    built: HashMap<Key, usize>,
    /// The report of each kind that has one.
    reports: Vec<Option<ObjectReport>>,
    /// The settings of the levels that stand for all objects, until they are baked.
    whole_settings: Option<BakeSettings>,
    /// The reports of these levels.
    whole: Vec<LevelReport>,
    notes: Vec<String>,
    seconds: StageSeconds,
}

/// An object to bake, or the whole scene.
pub struct ObjectSource {
    /// Its name in messages: that of the scene file and that of the object.
    pub name: String,
    /// Its settings.
    pub settings: BakeSettings,
    part: Part,
}

/// What a bake of a scene consists of.
enum Part {
    /// A kind of objects, and the file of one instance.
    Kind(usize, Vec<u8>),
    /// The levels that stand for all objects. They are baked from the scene file itself.
    Whole,
}

impl ObjectSource {
    /// The input of its bake. `scene` is that of the scene.
    pub fn source<'s>(&'s self, scene: &Source<'s>) -> Source<'s> {
        match &self.part {
            Part::Kind(_, glb) => Source { name: &self.name, bytes: glb, resources: &NoResources },
            Part::Whole => *scene,
        }
    }

    /// True for an object, false for the whole scene.
    pub fn is_object(&self) -> bool {
        matches!(self.part, Part::Kind(..))
    }
}

impl SceneBake {
    /// Reads a scene file and divides it into objects. `None` for a file that passes through, or that has no objects: it is
    /// baked as a whole.
    ///
    /// # Errors
    /// Those of the import, but for what the import of an object finds.
    pub fn open(source: &Source<'_>, settings: &BakeSettings, context: &Context<'_>) -> Result<Option<Self>, Error> {
        if !settings.enabled {
            return Ok(None);
        }
        let mut limits = ImportLimits::default();
        limits.memory = context.memory.unwrap_or(limits.memory);
        let rules = RuleMatcher::of(settings);
        let class = |name: &str| rules.find(name).bits();
        let mut scene = ObjectScene::read(source, &limits, (&settings.objects, class), &context.cancellation)?;
        let keeps_levels = settings.existing_lods == ExistingLods::Keep;
        if scene.kinds().is_empty() || scene.is_baked && keeps_levels {
            return Ok(None);
        }
        if let AtlasSize::Texels(side) = settings.shared_atlas {
            scene.share_textures(side, settings.texture_format);
        }
        let reports = scene.kinds().iter().map(|_| None).collect();
        Ok(Some(Self {
            scene,
            asset: source.name.to_owned(),
            settings: settings.clone(),
            keeps_levels,
            next: 0,
            built: HashMap::new(),
            reports,
            whole_settings: whole_settings(settings),
            whole: Vec::new(),
            notes: Vec::new(),
            seconds: Vec::new(),
        }))
    }

    /// The next object to bake; behind all objects the whole scene, if levels are to stand for all of them. Small objects and
    /// those that equal an earlier one are left out. `None` after the last.
    ///
    /// # Errors
    /// [`Error::Limit`] for an object above 4 GiB, and the error of a bake that was cancelled.
    pub fn next_object(&mut self, context: &Context<'_>) -> Result<Option<ObjectSource>, Error> {
        while let Some(found) = self.scene.kinds().get(self.next) {
            let kind = self.next;
            self.next += 1;
            let settings = self.settings.with_object_rules(MatchingRules::from_bits(found.class));
            let (name, instances, faces) = (format!("{}: {}", self.asset, found.name), found.instances, found.faces);
            let own = if self.keeps_levels { self.scene.build_own_levels(kind)? } else { Vec::new() };
            let settings = object_settings(&settings, faces);
            if settings.is_none() && own.is_empty() {
                continue;
            }
            let glb = self.scene.build(kind)?;
            let text = settings.as_ref().map(BakeSettings::to_ron).unwrap_or_default();
            let content = KeyBuilder::new(PIPELINE_VERSION).input(&glb).input(text.as_bytes());
            let content = own.iter().fold(content, |content, level| content.input(level)).finish();
            let first = *self.built.entry(content).or_insert(kind);
            if first != kind {
                self.scene.share(kind, first);
                self.reports[first].iter_mut().for_each(|report| report.instances += instances);
                continue;
            }
            let fewest = self.use_own_levels(kind, (&name, &glb), &own, context)?;
            if let Some(settings) = settings.and_then(|settings| below(settings, fewest)) {
                return Ok(Some(ObjectSource { name, settings, part: Part::Kind(kind, glb) }));
            }
        }
        let Some(settings) = self.whole_settings.take() else { return Ok(None) };
        self.show(context)?;
        Ok(Some(ObjectSource { name: self.asset.clone(), settings, part: Part::Whole }))
    }

    /// Shows the levels of all objects. Those that stand for all of them take much longer where the cache has the others.
    fn show(&self, context: &Context<'_>) -> Result<(), Error> {
        let has_levels = self.reports.iter().flatten().any(ObjectReport::has_levels);
        let Some(sink) = context.preview.filter(|_| has_levels) else { return Ok(()) };
        let mut scene = self.scene.clone();
        scene.write_shared_textures(&context.cancellation)?;
        sink.show(scene.finish(self.settings.source.is_kept(), PIPELINE_VERSION)?);
        Ok(())
    }

    /// Uses the levels that a kind of objects came with, as far as they fit. Returns the triangles of the smallest.
    fn use_own_levels(
        &mut self,
        kind: usize,
        (name, glb): (&str, &[u8]),
        levels: &[Vec<u8>],
        context: &Context<'_>,
    ) -> Result<Option<u64>, Error> {
        if levels.is_empty() {
            return Ok(None);
        }
        self.scene.use_own_levels(kind, &own_levels::errors(name, glb, levels, context)?);
        let found = &self.scene.kinds()[kind];
        let own: Vec<OwnLevelReport> =
            found.own_levels().map(|(faces, error)| OwnLevelReport { faces, error }).collect();
        let fewest = own.iter().map(|level| level.faces).min();
        let report = |_| ObjectReport {
            name: found.name.clone(),
            instances: found.instances,
            source_faces: found.faces,
            levels: Vec::new(),
            own_levels: own,
        };
        self.reports[kind] = fewest.map(report);
        Ok(fewest)
    }

    /// Takes the result of a bake: binary glTF and its report. An object that cannot be baked keeps its own mesh, and the
    /// report says why.
    ///
    /// # Errors
    /// The error of a bake that was cancelled, or that shows that the settings are wrong.
    pub fn take(&mut self, object: &ObjectSource, result: Result<(Vec<u8>, Report), Error>) -> Result<(), Error> {
        let (glb, report) = match result {
            Ok(result) => result,
            Err(error @ (Error::Cancelled { .. } | Error::Settings(_))) => return Err(error),
            Err(error) => {
                let what =
                    if object.is_object() { "an object gets no levels" } else { "no level stands for all objects" };
                self.notes.push(format!("{what}: {error}"));
                return Ok(());
            }
        };
        self.add_seconds(&report.seconds);
        let is_baked = report.status == Status::Baked;
        match object.part {
            Part::Kind(kind, _) => self.take_kind(kind, is_baked.then_some(glb), report),
            Part::Whole => self.take_whole(is_baked.then_some(glb), report),
        }
    }

    fn take_kind(&mut self, kind: usize, glb: Option<Vec<u8>>, report: Report) -> Result<(), Error> {
        glb.map_or(Ok(()), |glb| self.scene.take_levels(kind, &glb))?;
        let found = &self.scene.kinds()[kind];
        self.notes.extend(report.notes.iter().map(|note| format!("{}: {note}", found.name)));
        let own_levels = self.reports[kind].take().map(|report| report.own_levels).unwrap_or_default();
        let fewest = own_levels.iter().map(|level| level.faces).min().unwrap_or(u64::MAX);
        let mut levels = report.levels;
        levels.retain(|level| u64::from(level.faces) < fewest);
        self.reports[kind] = Some(ObjectReport {
            name: found.name.clone(),
            instances: found.instances,
            source_faces: report.source_faces,
            levels,
            own_levels,
        });
        Ok(())
    }

    fn take_whole(&mut self, glb: Option<Vec<u8>>, report: Report) -> Result<(), Error> {
        let of_all = |text: &String| format!("all objects: {text}");
        self.notes.extend(report.notes.iter().map(of_all));
        let Some(glb) = glb else { return Ok(()) };
        self.scene.take_whole(&glb)?;
        let with_name = |level: LevelReport| LevelReport { warning: level.warning.as_ref().map(of_all), ..level };
        self.whole = report.levels.into_iter().map(with_name).collect();
        Ok(())
    }

    fn add_seconds(&mut self, seconds: &StageSeconds) {
        for (stage, seconds) in seconds {
            match self.seconds.iter_mut().find(|(known, _)| known == stage) {
                Some((_, sum)) => *sum += seconds,
                None => self.seconds.push((stage.clone(), *seconds)),
            }
        }
    }

    /// The part of the progress of the whole bake that `object` has.
    pub fn progress<'s>(&self, object: &ObjectSource, sink: &'s dyn ProgressSink) -> ObjectProgress<'s> {
        let kinds = self.scene.kinds().len();
        let share = 1.0 / (kinds + usize::from(!self.settings.whole.0.is_empty())) as f32;
        let number = if let Part::Kind(kind, _) = object.part { kind } else { kinds };
        ObjectProgress { sink, begin: number as f32 * share, share }
    }

    /// The scene with the levels of all objects.
    ///
    /// # Errors
    /// [`Error::Limit`] above 4 GiB, and the error of a bake that was cancelled.
    pub fn finish(self, context: &Context<'_>) -> Result<Baked, Error> {
        let Self { mut scene, settings, reports, whole, mut notes, seconds, .. } = self;
        if let Some(side) = scene.write_shared_textures(&context.cancellation)? {
            notes.push(format!("the smallest levels of all objects share textures of {side} x {side} texels"));
        }
        let left_out = scene.levels_left_out;
        if left_out > 0 && self.keeps_levels {
            notes.push(format!(
                "{left_out} of the file's own levels are left out: a level is one mesh without morph targets, of one object, with \
                 its place, size and skin"
            ));
        }
        let source_faces = scene.kinds().iter().map(|kind| kind.faces * u64::from(kind.instances)).sum();
        let glb = scene.finish(settings.source.is_kept(), PIPELINE_VERSION)?;
        let objects: Vec<ObjectReport> = reports.into_iter().flatten().collect();
        let has_levels = !whole.is_empty() || objects.iter().any(ObjectReport::has_levels);
        let status = if has_levels { Status::Baked } else { Status::SmallEnough };
        let report = Report { status, source_faces, levels: whole, objects, notes, seconds };
        Ok(Baked { glb, levels: Vec::new(), model: None, report })
    }
}

/// Passes the progress of an object on, as a part of that of its scene.
pub struct ObjectProgress<'a> {
    sink: &'a dyn ProgressSink,
    begin: f32,
    share: f32,
}

impl ProgressSink for ObjectProgress<'_> {
    fn report(&self, progress: Progress) {
        let fraction = self.begin + self.share * progress.fraction;
        self.sink.report(Progress { fraction, ..progress });
    }
}

/// Settings without those that concern the scene: they are the built-in ones, so that objects of all scenes have the same
/// keys. The scene has the meshes of its own.
fn without_scene(settings: &BakeSettings) -> BakeSettings {
    let BakeSettings { objects, object_faces, object_rules, whole, shared_atlas, .. } = BakeSettings::default();
    let (scope, source) = (Scope::Scene, SourceGeometry::Drop);
    BakeSettings { scope, objects, object_faces, object_rules, whole, shared_atlas, source, ..settings.clone() }
}

/// The settings of the levels that stand for all objects; `None` if there are to be none. All candidates compete, as few
/// triangles cannot hold hundreds of surfaces apart, and one material makes one draw call of them.
fn whole_settings(settings: &BakeSettings) -> Option<BakeSettings> {
    let (faces, targets, candidates) = (settings.whole.0.clone(), Vec::new(), Candidates::All);
    let materials = LevelMaterials::Baked;
    (!faces.is_empty()).then(|| BakeSettings { faces, targets, candidates, materials, ..without_scene(settings) })
}

/// The settings of an object of so many triangles. `None` for one that is too small for levels.
fn object_settings(settings: &BakeSettings, faces: u64) -> Option<BakeSettings> {
    if faces < u64::from(settings.object_faces) {
        return None;
    }
    let faces = if settings.targets.is_empty() { budgets(&settings.faces, faces) } else { settings.faces.clone() };
    (!faces.is_empty()).then(|| BakeSettings { faces, ..without_scene(settings) })
}

/// The settings of an object that has levels down to `fewest` triangles: budgets are at most half of that. `None` if no level
/// is left to bake.
fn below(mut settings: BakeSettings, fewest: Option<u64>) -> Option<BakeSettings> {
    if settings.targets.is_empty() {
        settings.faces.retain(|&budget| 2 * u64::from(budget) <= fewest.unwrap_or(u64::MAX));
    }
    (!settings.faces.is_empty()).then_some(settings)
}

/// The budgets of an object of so many triangles, ascending: at most those that were asked for, and at most half of the next.
fn budgets(wanted: &[u32], faces: u64) -> Vec<u32> {
    let halve = |above: &mut u64, &budget: &u32| {
        *above = (*above / 2).min(u64::from(budget));
        Some(*above)
    };
    let budgets = wanted.iter().rev().scan(faces, halve).take_while(|&budget| budget >= FEWEST);
    let mut budgets: Vec<u32> = budgets.map(|budget| budget as u32).collect();
    budgets.reverse();
    budgets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_suit_the_size_of_an_object() {
        let of = |faces| budgets(&[1000, 2000, 4000], faces);
        assert_eq!(of(100_000), [1000, 2000, 4000]);
        assert_eq!(of(5000), [625, 1250, 2500]);
        assert_eq!(of(100), [12, 25, 50]);
        assert_eq!(of(30), [15]);
        assert_eq!(of(23), [0; 0]);
        assert_eq!(budgets(&[3000, 4000], 100_000), [2000, 4000]);
    }

    #[test]
    fn levels_are_baked_below_those_that_an_object_has() {
        let settings = BakeSettings { faces: vec![500, 1000, 2000], ..BakeSettings::default() };
        let of = |fewest| below(settings.clone(), fewest).map(|settings| settings.faces);
        assert_eq!(of(None), Some(vec![500, 1000, 2000]));
        assert_eq!(of(Some(2000)), Some(vec![500, 1000]));
        assert_eq!(of(Some(999)), None);
    }

    #[test]
    fn objects_share_keys_whatever_their_scene_asks_for() {
        let base = BakeSettings { scope: Scope::Objects, ..BakeSettings::default() };
        let other = BakeSettings { object_faces: 50, source: SourceGeometry::Drop, ..base.clone() };
        let of = |settings| object_settings(settings, 9000).expect("large enough");
        assert_eq!(of(&base), of(&other));
        assert_eq!((of(&base).scope, &of(&base).faces[..]), (Scope::Scene, &[1000, 2000, 4000][..]));
        assert_eq!(object_settings(&base, 99), None);
    }
}
