//! The system that loads and drops sources and levels.

use bevy::asset::{AssetPath, LoadState, RenderAssetUsages};
use bevy::ecs::system::SystemParam;
use bevy::gltf::convert_coordinates::GltfConvertCoordinates;
use bevy::gltf::{Gltf, GltfLoaderSettings};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::prelude::*;
use bevy::world_serialization::WorldAsset;

use super::components::{OnDemand, OnDemandPart, Presence, SourceSettings, SourceStats};
use super::contents::{Filled, Places, Stores};
use super::materials;
use super::need::{Candidate, NEAR, choose, distance_ahead};
use crate::lod::components::{LodGroup, LodSettings};
use crate::lod::distance::FADE_STEPS;
use crate::lod::switch::LodState;

/// Seconds between two looks at the distances of all instances.
const INTERVAL: f32 = 0.1;
/// Most files that are loaded at the same time.
const MOST_LOADS: usize = 4;
/// Frames after which a renderer has what was moved into its place.
const SETTLING: u8 = 3;

/// A source or a level: the path of its model, and its number.
type Key = (AssetPath<'static>, u32);

/// The sources and levels that are there or on their way.
#[derive(Resource, Default)]
pub(in crate::lod) struct Residency {
    parts: HashMap<Key, Part>,
    /// Seconds since the last look.
    since: f32,
}

/// The source of a model, or a level.
struct Part {
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

/// The assets that parts are made of.
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

/// Everything that shows sources and levels.
#[derive(SystemParam)]
pub(in crate::lod) struct Instances<'w, 's> {
    roots: Query<'w, 's, (Entity, &'static OnDemand, &'static mut Presence)>,
    added: Query<'w, 's, (), Added<OnDemand>>,
    groups: Query<'w, 's, (&'static LodGroup, &'static LodState)>,
}

/// Loads the sources and levels that cameras come near to, and drops those that nobody wants.
pub(in crate::lod) fn update(
    mut commands: Commands<'_, '_>,
    (settings, lods, time): (Res<'_, SourceSettings>, Res<'_, LodSettings>, Res<'_, Time<Real>>),
    (mut residency, mut stats): (ResMut<'_, Residency>, ResMut<'_, SourceStats>),
    mut contents: Contents<'_, '_>,
    mut instances: Instances<'_, '_>,
) {
    let residency = &mut *residency;
    let loaded = contents.loaded();
    for (_, part) in residency.parts.iter_mut().filter(|((model, _), _)| loaded.contains(model)) {
        // Its file has brought its own placeholders.
        part.places.forget();
        (part.phase, part.steps) = (Phase::Away, 0);
    }
    residency.since += time.delta_secs();
    let is_look =
        residency.since >= INTERVAL || instances.roots.iter().any(|(root, ..)| instances.added.contains(root));
    if is_look {
        residency.look(&settings, &lods, &mut instances);
    }
    let (mut changed, mut is_seen_otherwise) = (HashSet::new(), is_look || !loaded.is_empty());
    for (key, part) in &mut residency.parts {
        let before = part.presence();
        if part.step(key, &mut contents) {
            changed.insert(key.clone());
        }
        is_seen_otherwise |= part.presence() != before;
    }
    residency.parts.retain(|_, part| !matches!(part.phase, Phase::Away) || part.places.is_loaded(&contents.meshes));
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
    /// The mesh entities of these sources and levels.
    fn entities(&self, parts: &HashSet<Key>) -> Vec<Entity> {
        let groups = self.groups.iter().filter_map(|(group, state)| {
            let (_, on_demand, _) = self.roots.get(state.on_demand()?).ok()?;
            Some((group, on_demand.parts.first()?.model()?))
        });
        let of_group = |(group, model): (&LodGroup, AssetPath<'static>)| {
            let levels = group.levels.iter().filter(|level| parts.contains(&(model.clone(), level.level)));
            levels.flat_map(|level| level.primitives.iter().map(|primitive| primitive.entity)).collect::<Vec<Entity>>()
        };
        groups.flat_map(of_group).collect()
    }

    /// The least distance of each source and each level of a scene.
    fn distances(&self, settings: &LodSettings) -> HashMap<(Entity, u32), f32> {
        let mut nearest: HashMap<(Entity, u32), f32> = HashMap::default();
        for (group, state) in &self.groups {
            let Some(root) = state.on_demand() else { continue };
            for (slot, level) in group.levels.iter().enumerate() {
                let known = nearest.entry((root, level.level)).or_insert(f32::INFINITY);
                *known = known.min(state.distance(slot, settings));
            }
        }
        nearest
    }
}

impl Residency {
    /// Looks at the distances of all instances, and chooses what is to be there.
    fn look(&mut self, settings: &SourceSettings, lods: &LodSettings, instances: &mut Instances<'_, '_>) {
        let seconds = std::mem::take(&mut self.since);
        for part in self.parts.values_mut() {
            part.distance = f32::INFINITY;
        }
        let distances = instances.distances(lods);
        for (root, on_demand, mut presence) in &mut instances.roots {
            for (of, seen) in on_demand.parts.iter().zip(&mut presence.bypass_change_detection().0) {
                let Some(model) = of.model() else { continue };
                let new = || Part::new(of, on_demand.rotate_meshes);
                let part = self.parts.entry((model, of.level)).or_insert_with(new);
                if part.file != AssetPath::from(of.file.clone()) {
                    *part = new();
                }
                let known = distances.get(&(root, of.level)).copied().unwrap_or(f32::INFINITY);
                let now = if of.always { 0.0 } else { known };
                part.distance = part.distance.min(distance_ahead(seen.before, now, seconds, settings.ahead));
                seen.before = now;
            }
        }
        let mut parts: Vec<(&Key, &mut Part)> = self.parts.iter_mut().collect();
        parts.sort_by(|((a, of_a), _), ((b, of_b), _)| a.path().cmp(b.path()).then(of_a.cmp(of_b)));
        let candidates: Vec<Candidate> =
            parts.iter_mut().map(|(_, part)| part.candidate(seconds, settings.keep)).collect();
        for ((_, part), is_chosen) in parts.iter_mut().zip(choose(&candidates, settings.budget)) {
            part.is_chosen = is_chosen;
        }
    }

    /// Starts to load what is to be there, as far as the rest leaves room.
    fn start(&mut self, settings: &SourceSettings, server: &AssetServer) {
        let mut bytes = self.bytes();
        let mut loads = self.parts.values().filter(|part| matches!(part.phase, Phase::Loading(_))).count();
        let is_new = |part: &&mut Part| part.is_chosen && part.distance < NEAR && matches!(part.phase, Phase::Away);
        let mut new: Vec<&mut Part> = self.parts.values_mut().filter(is_new).collect();
        new.sort_by(|a, b| a.distance.total_cmp(&b.distance).then_with(|| a.file.path().cmp(b.file.path())));
        for part in new {
            if loads < MOST_LOADS && bytes + part.bytes <= settings.budget {
                part.load(server);
                (bytes, loads) = (bytes + part.bytes, loads + 1);
            }
        }
    }

    /// Tells all instances how much of their sources and levels may be seen.
    fn show(&self, instances: &mut Instances<'_, '_>) {
        for (_, on_demand, mut presence) in &mut instances.roots {
            for (of, seen) in on_demand.parts.iter().zip(&mut presence.bypass_change_detection().0) {
                let part = of.model().and_then(|model| self.parts.get(&(model, of.level)));
                seen.steps = part.and_then(Part::presence);
            }
        }
    }

    fn bytes(&self) -> u64 {
        self.parts.values().filter(|part| part.is_held()).map(|part| part.bytes).sum()
    }

    fn stats(&self) -> SourceStats {
        let count = |is_source: bool, is: fn(&Phase) -> bool| {
            let parts = self.parts.iter().filter(|((_, level), part)| (*level == 0) == is_source && is(&part.phase));
            parts.count() as u32
        };
        let is_there = |phase: &Phase| matches!(phase, Phase::There(_));
        SourceStats {
            models: count(true, |_| true),
            resident: count(true, is_there),
            loading: count(true, |phase| matches!(phase, Phase::Loading(_) | Phase::Filling(_))),
            failed: count(true, |phase| matches!(phase, Phase::Failed)),
            levels: count(false, is_there),
            bytes: self.bytes(),
        }
    }
}

impl Part {
    fn new(of: &OnDemandPart, rotate_meshes: bool) -> Self {
        Self {
            file: AssetPath::from(of.file.clone()),
            bytes: of.bytes,
            places: Places::of(of),
            rotate_meshes,
            phase: Phase::Away,
            steps: 0,
            unwanted: f32::INFINITY,
            distance: f32::INFINITY,
            is_chosen: false,
        }
    }

    /// The sixteenths that may be seen, once it is in its place.
    fn presence(&self) -> Option<u8> {
        matches!(self.phase, Phase::There(_)).then_some(self.steps)
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
    fn step(&mut self, key: &Key, contents: &mut Contents<'_, '_>) -> bool {
        match std::mem::replace(&mut self.phase, Phase::Away) {
            Phase::Loading(file) if self.is_chosen => {
                self.phase = match contents.server.load_state(&file) {
                    LoadState::Loaded => Phase::Filling(file),
                    LoadState::Failed(error) => self.fail(key, &error.to_string()),
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
                        self.fail(key, "it lacks meshes or textures")
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

    fn fail(&mut self, (model, level): &Key, why: &str) -> Phase {
        let (what, file) = (if *level == 0 { "source".into() } else { format!("LOD{level}") }, &self.file);
        warn!("{model}: the next coarser level is shown in place of the {what}, {file}: {why}");
        Phase::Failed
    }
}
