//! The system that loads and drops sources.

use bevy::asset::{AssetPath, LoadState, RenderAssetUsages};
use bevy::ecs::system::SystemParam;
use bevy::gltf::convert_coordinates::GltfConvertCoordinates;
use bevy::gltf::{Gltf, GltfLoaderSettings};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::*;
use bevy::world_serialization::WorldAsset;

use super::components::{OnDemandSource, Presence, SourceSettings, SourceStats};
use super::contents::{Filled, Places, Stores};
use super::materials;
use super::need::{Candidate, NEAR, choose, distance_ahead};
use crate::lod::components::LodGroup;
use crate::lod::distance::FADE_STEPS;
use crate::lod::switch::LodState;

/// Seconds between two looks at the distances of all instances.
const INTERVAL: f32 = 0.1;
/// Most sources that are loaded at the same time.
const MOST_LOADS: usize = 4;
/// Frames after which a renderer has what was moved into its place.
const SETTLING: u8 = 3;

/// The sources that are there or on their way, by the paths of their models.
#[derive(Resource, Default)]
pub(in crate::lod) struct Residency {
    models: HashMap<AssetPath<'static>, Model>,
    /// Seconds since the last look.
    since: f32,
}

/// The source of a model.
struct Model {
    file: AssetPath<'static>,
    bytes: u64,
    places: Places,
    rotate_meshes: bool,
    phase: Phase,
    /// Sixteenths that may be seen.
    steps: u8,
    /// Seconds since it was wanted last.
    unwanted: f32,
    distance: f32,
    is_chosen: bool,
}

#[derive(Debug)]
enum Phase {
    Away,
    Loading(Handle<Gltf>),
    /// It is moved into its place.
    Filling(Handle<Gltf>),
    /// It is in place for so many frames.
    There(u8),
    Failed,
}

/// The assets that sources are made of.
#[derive(SystemParam)]
pub(in crate::lod) struct Contents<'w, 's> {
    server: Res<'w, AssetServer>,
    meshes: ResMut<'w, Assets<Mesh>>,
    images: ResMut<'w, Assets<Image>>,
    scenes: MessageReader<'w, 's, AssetEvent<WorldAsset>>,
}

impl Contents<'_, '_> {
    /// The files whose scenes were loaded, for the first time or anew.
    fn loaded(&mut self) -> Vec<AssetPath<'static>> {
        let ids = self.scenes.read().filter_map(|event| match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => Some(*id),
            _ => None,
        });
        let paths = ids.filter_map(|id| Some(self.server.get_path(id)?.without_label().clone_owned()));
        paths.collect()
    }

    fn stores(&mut self) -> Stores<'_> {
        Stores { server: &self.server, meshes: &mut self.meshes, images: &mut self.images }
    }
}

/// Everything that shows sources.
#[derive(SystemParam)]
pub(in crate::lod) struct Instances<'w, 's> {
    roots: Query<'w, 's, (Entity, &'static OnDemandSource, &'static mut Presence)>,
    added: Query<'w, 's, (), Added<OnDemandSource>>,
    groups: Query<'w, 's, (&'static LodGroup, &'static LodState)>,
}

/// Loads the sources that cameras come near to, and drops those that nobody wants.
pub(in crate::lod) fn update(
    mut commands: Commands<'_, '_>,
    (settings, time): (Res<'_, SourceSettings>, Res<'_, Time<Real>>),
    (mut residency, mut stats): (ResMut<'_, Residency>, ResMut<'_, SourceStats>),
    mut contents: Contents<'_, '_>,
    mut instances: Instances<'_, '_>,
) {
    let residency = &mut *residency;
    let loaded = contents.loaded();
    for path in &loaded {
        if let Some(model) = residency.models.get_mut(path) {
            // Its file has brought its own placeholders.
            model.places.forget();
            (model.phase, model.steps) = (Phase::Away, 0);
        }
    }
    residency.since += time.delta_secs();
    let is_look =
        residency.since >= INTERVAL || instances.roots.iter().any(|(root, ..)| instances.added.contains(root));
    if is_look {
        residency.look(&settings, &mut instances);
    }
    let (mut changed, mut is_seen_otherwise) = (HashSet::new(), is_look || !loaded.is_empty());
    for (path, model) in &mut residency.models {
        let steps = model.steps;
        if model.step(path, &mut contents) {
            changed.insert(path.clone());
        }
        is_seen_otherwise |= model.steps != steps;
    }
    residency.models.retain(|_, model| !matches!(model.phase, Phase::Away) || model.places.is_loaded(&contents.meshes));
    residency.start(&settings, &contents.server);
    if is_seen_otherwise {
        residency.show(&mut instances);
    }
    if !changed.is_empty() {
        let entities = instances.entities(&changed);
        commands.queue(move |world: &mut World| materials::refresh(world, entities));
    }
    let now = residency.stats();
    stats.set_if_neq(now);
}

impl Instances<'_, '_> {
    /// The mesh entities of the sources of these models.
    fn entities(&self, models: &HashSet<AssetPath<'static>>) -> Vec<Entity> {
        let is_of = |state: &LodState| {
            let source = state.source().and_then(|root| self.roots.get(root).ok());
            source.and_then(|(_, source, _)| source.model()).is_some_and(|model| models.contains(&model))
        };
        let groups = self.groups.iter().filter(|(_, state)| is_of(state));
        let sources = groups.filter_map(|(group, _)| group.levels.first().filter(|level| level.level == 0));
        sources.flat_map(|level| level.primitives.iter().map(|primitive| primitive.entity)).collect()
    }

    /// The distance of each instance.
    fn distances(&self) -> HashMap<Entity, f32> {
        let mut nearest: HashMap<Entity, f32> = HashMap::default();
        for (_, state) in &self.groups {
            let Some(source) = state.source() else { continue };
            let known = nearest.entry(source).or_insert(f32::INFINITY);
            *known = known.min(state.distance());
        }
        nearest
    }
}

impl Residency {
    /// Looks at the distances of all instances, and chooses the sources that are to be there.
    fn look(&mut self, settings: &SourceSettings, instances: &mut Instances<'_, '_>) {
        let seconds = std::mem::take(&mut self.since);
        for model in self.models.values_mut() {
            model.distance = f32::INFINITY;
        }
        let distances = instances.distances();
        for (root, source, mut presence) in &mut instances.roots {
            let Some(path) = source.model() else { continue };
            let model = self.models.entry(path).or_insert_with(|| Model::new(source));
            if model.file != AssetPath::from(source.file.clone()) {
                *model = Model::new(source);
            }
            let now = if source.always { 0.0 } else { distances.get(&root).copied().unwrap_or(f32::INFINITY) };
            model.distance = model.distance.min(distance_ahead(presence.before, now, seconds, settings.ahead));
            presence.before = now;
        }
        let mut models: Vec<(&AssetPath<'static>, &mut Model)> = self.models.iter_mut().collect();
        models.sort_by(|(a, _), (b, _)| a.path().cmp(b.path()));
        let candidates: Vec<Candidate> =
            models.iter_mut().map(|(_, model)| model.candidate(seconds, settings.keep)).collect();
        for ((_, model), is_chosen) in models.iter_mut().zip(choose(&candidates, settings.budget)) {
            model.is_chosen = is_chosen;
        }
    }

    /// Starts to load the sources that are to be there, as far as the others leave room.
    fn start(&mut self, settings: &SourceSettings, server: &AssetServer) {
        let mut bytes = self.bytes();
        let mut loads = self.models.values().filter(|model| matches!(model.phase, Phase::Loading(_))).count();
        let is_new =
            |model: &&mut Model| model.is_chosen && model.distance < NEAR && matches!(model.phase, Phase::Away);
        let mut new: Vec<&mut Model> = self.models.values_mut().filter(is_new).collect();
        new.sort_by(|a, b| a.distance.total_cmp(&b.distance).then_with(|| a.file.path().cmp(b.file.path())));
        for model in new {
            if loads < MOST_LOADS && bytes + model.bytes <= settings.budget {
                model.load(server);
                (bytes, loads) = (bytes + model.bytes, loads + 1);
            }
        }
    }

    /// Tells all instances how much of their sources may be seen.
    fn show(&self, instances: &mut Instances<'_, '_>) {
        for (_, source, mut presence) in &mut instances.roots {
            let model = source.model().and_then(|path| self.models.get(&path));
            let steps = model.map_or(0, |model| model.steps);
            if presence.steps != steps {
                presence.steps = steps;
            }
        }
    }

    fn bytes(&self) -> u64 {
        self.models.values().filter(|model| model.is_held()).map(|model| model.bytes).sum()
    }

    fn stats(&self) -> SourceStats {
        let count = |is: fn(&Phase) -> bool| self.models.values().filter(|model| is(&model.phase)).count() as u32;
        SourceStats {
            models: self.models.len() as u32,
            resident: count(|phase| matches!(phase, Phase::There(_))),
            loading: count(|phase| matches!(phase, Phase::Loading(_) | Phase::Filling(_))),
            failed: count(|phase| matches!(phase, Phase::Failed)),
            bytes: self.bytes(),
        }
    }
}

impl Model {
    fn new(source: &OnDemandSource) -> Self {
        Self {
            file: AssetPath::from(source.file.clone()),
            bytes: source.bytes,
            places: Places::of(source),
            rotate_meshes: source.rotate_meshes,
            phase: Phase::Away,
            steps: 0,
            unwanted: f32::INFINITY,
            distance: f32::INFINITY,
            is_chosen: false,
        }
    }

    fn is_held(&self) -> bool {
        !matches!(self.phase, Phase::Away | Phase::Failed)
    }

    fn candidate(&mut self, seconds: f32, keep: f32) -> Candidate {
        self.unwanted = if self.distance < NEAR { 0.0 } else { self.unwanted + seconds };
        let is_recent = self.unwanted <= keep && !matches!(self.phase, Phase::Failed);
        // One that is on its way and no longer wanted is not waited for.
        let is_recent = is_recent && (self.unwanted == 0.0 || matches!(self.phase, Phase::There(_)));
        Candidate { distance: self.distance, is_recent, is_held: self.is_held(), bytes: self.bytes }
    }

    fn load(&mut self, server: &AssetServer) {
        let rotate_meshes = self.rotate_meshes;
        let settings = move |settings: &mut GltfLoaderSettings| {
            // The renderer gets them in their places alone.
            (settings.load_meshes, settings.load_materials) =
                (RenderAssetUsages::MAIN_WORLD, RenderAssetUsages::MAIN_WORLD);
            (settings.load_cameras, settings.load_lights, settings.load_animations) = (false, false, false);
            settings.convert_coordinates = Some(GltfConvertCoordinates { rotate_meshes, ..default() });
        };
        self.phase = Phase::Loading(server.load_builder().with_settings(settings).load(self.file.clone()));
    }

    /// Goes on with what is on its way. Tells whether textures have changed.
    fn step(&mut self, path: &AssetPath<'static>, contents: &mut Contents<'_, '_>) -> bool {
        match std::mem::replace(&mut self.phase, Phase::Away) {
            Phase::Loading(file) if self.is_chosen => {
                self.phase = match contents.server.load_state(&file) {
                    LoadState::Loaded => Phase::Filling(file),
                    LoadState::Failed(error) => self.fail(path, &error.to_string()),
                    _ => Phase::Loading(file),
                };
                false
            }
            Phase::Filling(file) if self.is_chosen => {
                let filled = self.places.fill(&self.file, &mut contents.stores());
                self.phase = match filled {
                    Filled::Partly => Phase::Filling(file),
                    Filled::All => Phase::There(0),
                    Filled::Failed => {
                        self.places.empty(&mut contents.stores());
                        self.fail(path, "it lacks meshes or textures")
                    }
                };
                filled != Filled::Partly
            }
            Phase::There(frames) if self.is_chosen || self.steps > 0 => {
                self.phase = Phase::There(frames.saturating_add(1));
                if self.is_chosen && frames >= SETTLING {
                    self.steps = (self.steps + 1).min(FADE_STEPS);
                } else if !self.is_chosen {
                    self.steps -= 1;
                }
                false
            }
            // Nobody wants it any more, or nobody sees it.
            Phase::Filling(_) | Phase::There(_) => self.places.empty(&mut contents.stores()),
            Phase::Loading(_) | Phase::Away => false,
            Phase::Failed => {
                self.phase = Phase::Failed;
                false
            }
        }
    }

    fn fail(&mut self, path: &AssetPath<'static>, why: &str) -> Phase {
        warn!("{path}: the most detailed level is shown in place of the source, {}: {why}", self.file);
        Phase::Failed
    }
}
