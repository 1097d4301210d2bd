//! The systems that select a level for each group and show it.

use bevy::camera::visibility::VisibilityRange;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use bevy::world_serialization::WorldAssetRoot;

use super::components::{LodGroup, LodLevel, LodMember, LodSettings, SimpliguardLods};
use super::cover::{Cover, stand_in};
use super::distance::{Choice, FADE_STEPS, Rung, View, choose, level_distance, rungs};
use super::fade::Show;
use super::kept::KeptObjects;
use super::on_demand::{OnDemand, Presence};

/// The state of a group between frames.
#[derive(Component)]
pub(super) struct LodState {
    /// The entity with [`SimpliguardLods`].
    root: Entity,
    /// The entity with the scene that this is an object of.
    scene: Option<Entity>,
    /// The entity with [`OnDemand`], if levels are loaded on demand.
    on_demand: Option<Entity>,
    nearness: Nearness,
    rungs: Vec<Rung>,
    /// The levels that are shown. `None` before the first selection.
    choice: Option<Choice>,
    /// The level in place of a source that is not there yet.
    cover: Option<Cover>,
    /// What the levels leave of it that stand for all objects.
    veil: Veil,
    /// True if `veil` differs from what is shown.
    is_veil_changed: bool,
    /// True if a part of the source is hidden, so that no level can stand for it.
    is_source_cut: bool,
    /// True if `is_source_cut` has to be computed again.
    is_source_changed: bool,
}

/// The measure that tells which levels are near enough to be wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Nearness {
    /// There is no camera.
    Unknown,
    /// This level is wanted from any distance.
    Only(usize),
    /// The diagonal of the object is so many pixels long.
    Size(f32),
}

/// What is left of an object while levels that stand for all objects are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Veil {
    /// Everything.
    #[default]
    None,
    /// All but so many sixteenths of the pixels, from 1 to 15.
    Fading(u8),
    /// Nothing.
    Hidden,
}

impl Veil {
    /// The veil over the objects while the levels that stand for all of them show this.
    fn of(choice: Choice) -> Self {
        match choice {
            Choice { slot: 0, next: None } => Self::None,
            Choice { slot: 0, next: Some((_, step)) } => Self::Fading(step),
            _ => Self::Hidden,
        }
    }
}

impl LodState {
    pub(super) fn choice(&self) -> Option<Choice> {
        self.choice
    }

    /// The entity with [`OnDemand`].
    pub(super) fn on_demand(&self) -> Option<Entity> {
        self.on_demand
    }

    /// The distance in units of the one below which a level, or a more detailed one, is seen.
    pub(super) fn distance(&self, slot: usize, settings: &LodSettings) -> f32 {
        match self.nearness {
            Nearness::Only(only) if only == slot => 0.0,
            Nearness::Only(_) | Nearness::Unknown => f32::INFINITY,
            Nearness::Size(size) => {
                level_distance(&self.rungs, slot, size, settings.pixel_error, settings.fade.clamp(0.0, 1.0))
            }
        }
    }

    /// The indices of the levels that are drawn.
    pub(super) fn drawn(&self) -> impl Iterator<Item = usize> + use<> {
        let next = self.choice.and_then(|choice| Some(choice.next?.0));
        let cover = self.cover.map(|cover| cover.slot);
        let first = self.choice.map(|choice| choice.slot).filter(|_| self.cover.is_none_or(|cover| cover.step > 0));
        [first, next.filter(|next| cover != Some(*next)), cover].into_iter().flatten()
    }

    /// The levels that are drawn for a choice while some are away.
    fn drawn_for(
        &self,
        choice: Choice,
        levels: &[LodLevel],
        presences: &Query<'_, '_, &Presence>,
    ) -> (Choice, Option<Cover>) {
        let Some(presence) = self.on_demand.and_then(|entity| presences.get(entity).ok()) else {
            return (choice, None);
        };
        stand_in(choice, &self.rungs, |slot| presence.steps(levels.get(slot)?.level))
    }

    /// Index of the level with the most pixels.
    fn main(&self, choice: Choice) -> usize {
        self.cover.filter(|cover| 2 * cover.step < FADE_STEPS).map_or(choice.main(), |cover| cover.slot)
    }
}

/// Inserts the state into each group of a scene that was just spawned, and [`SimpliguardLods`] into the root: the one that
/// an object had before a reload, or a new one.
pub(super) fn attach(
    mut commands: Commands<'_, '_>,
    groups: Query<'_, '_, (Entity, &LodGroup, Option<&ChildOf>), Added<LodGroup>>,
    mut roots: Query<'_, '_, Option<&mut KeptObjects>, With<WorldAssetRoot>>,
    (parents, on_demand): (Query<'_, '_, &ChildOf>, Query<'_, '_, (), With<OnDemand>>),
) {
    for (group, levels, parent) in &groups {
        let parent = parent.map(ChildOf::parent);
        let instance = parents.iter_ancestors(group).find(|&ancestor| roots.contains(ancestor));
        let root = parent.filter(|_| parent == instance && levels.object.is_empty()).unwrap_or(group);
        if let Some(instance) = instance.filter(|_| root == group) {
            match roots.get_mut(instance) {
                Ok(Some(mut kept)) => kept.restore(levels, &mut commands.entity(root)),
                _ => drop(commands.entity(instance).insert_if_new(KeptObjects::default())),
            }
        }
        commands.entity(root).insert_if_new(SimpliguardLods::default());
        let has_source = levels.objects.is_empty() && levels.levels.first().is_some_and(|level| level.level == 0);
        let mut above = std::iter::once(group).chain(parents.iter_ancestors(group));
        commands.entity(group).insert(LodState {
            root,
            scene: instance.filter(|&instance| instance != root),
            on_demand: above.find(|&entity| has_source && on_demand.contains(entity)),
            nearness: Nearness::Unknown,
            rungs: Vec::new(),
            choice: None,
            cover: None,
            veil: Veil::None,
            is_veil_changed: false,
            is_source_cut: false,
            is_source_changed: true,
        });
    }
}

/// Empties [`SimpliguardLods`] when its group is removed, for instance because the model is reloaded. What is set on an object
/// is kept on the instance of its scene.
pub(super) fn detach(
    event: On<'_, '_, Remove, LodGroup>,
    states: Query<'_, '_, (&LodGroup, &LodState, Option<&Visibility>)>,
    mut lods: Query<'_, '_, &mut SimpliguardLods>,
    mut instances: Query<'_, '_, &mut KeptObjects>,
) {
    let Ok((group, state, visibility)) = states.get(event.entity) else { return };
    let Ok(mut lods) = lods.get_mut(state.root) else { return };
    lods.levels.clear();
    lods.current = 0;
    if let Some(mut kept) = state.scene.and_then(|scene| instances.get_mut(scene).ok()) {
        kept.keep(group, &lods, visibility.copied().unwrap_or_default());
    }
}

/// Marks the groups whose source has parts that were hidden or shown.
pub(super) fn note_hidden_parts(
    members: Query<'_, '_, &LodMember, Changed<InheritedVisibility>>,
    mut groups: Query<'_, '_, (&LodGroup, &mut LodState)>,
    mut scenes: Local<'_, Vec<Entity>>,
) {
    scenes.clear();
    for member in members.iter().filter(|member| member.level == 0) {
        if let Ok((_, mut state)) = groups.get_mut(member.group) {
            state.is_source_changed = true;
            if let Some(scene) = state.scene.filter(|scene| !scenes.contains(scene)) {
                scenes.push(scene);
            }
        }
    }
    if scenes.is_empty() {
        return;
    }
    for (group, mut state) in &mut groups {
        if !group.objects.is_empty() && scenes.contains(&state.root) {
            state.is_source_changed = true;
        }
    }
}

/// The cameras, and the views of the active ones.
#[derive(SystemParam)]
pub(super) struct Cameras<'w, 's> {
    cameras: Query<'w, 's, (&'static Camera, &'static GlobalTransform), With<Camera3d>>,
    /// Kept between frames for its memory.
    views: Local<'s, Vec<View>>,
}

impl Cameras<'_, '_> {
    fn views(&mut self) -> &[View] {
        self.views.clear();
        self.views.extend(self.cameras.iter().filter_map(view));
        &self.views
    }
}

/// All groups and their mesh entities.
#[derive(SystemParam)]
pub(super) struct Members<'w, 's> {
    groups: Query<'w, 's, &'static LodGroup>,
    visibility: Query<'w, 's, &'static InheritedVisibility>,
    ranges: Query<'w, 's, &'static mut VisibilityRange>,
}

impl Members<'_, '_> {
    /// Tells whether a part of what a group stands for is hidden. Only meaningful while the group as a whole is shown.
    fn is_cut(&self, group: &LodGroup) -> bool {
        let objects = group.objects.iter().filter_map(|object| self.groups.get(*object).ok());
        let sources = objects.chain([group]).filter_map(|group| group.levels.first().filter(|level| level.level == 0));
        let mut parts = sources.flat_map(|level| &level.primitives);
        parts.any(|part| self.visibility.get(part.entity).is_ok_and(|v| !v.get()))
    }
}

/// Selects the level of each group and shows it. Levels that stand for all objects of a scene come first: what they show
/// hides the objects.
pub(super) fn switch_levels(
    settings: Res<'_, LodSettings>,
    mut cameras: Cameras<'_, '_>,
    mut groups: Query<'_, '_, (&LodGroup, &mut LodState, &GlobalTransform, Option<Ref<'_, InheritedVisibility>>)>,
    (mut lods, presences): (Query<'_, '_, &mut SimpliguardLods>, Query<'_, '_, &Presence>),
    mut members: Members<'_, '_>,
) {
    let selection = Selection { settings: &settings, views: cameras.views() };
    let fade = settings.fade.clamp(0.0, 1.0);
    for stands_for_all in [true, false] {
        let mut veiled: Vec<(Entity, Veil)> = Vec::new();
        for (group, mut state, transform, shown) in &mut groups {
            if group.objects.is_empty() == stands_for_all {
                continue;
            }
            let wish = Wish::of(state.scene.into_iter().chain([state.root]).filter_map(|entity| lods.get(entity).ok()));
            let is_shown = shown.as_ref().is_none_or(|v| v.get());
            if state.is_source_changed || shown.is_some_and(|v| v.is_changed()) {
                state.is_source_changed = false;
                state.is_source_cut = is_shown && members.is_cut(group);
            }
            let is_fresh = state.choice.is_none() || settings.is_changed();
            if is_fresh {
                state.rungs = rungs(group.levels.iter().map(|level| level.error), fade);
            }
            let (choice, nearness) = selection.choice(group, &state, transform, wish);
            state.nearness = nearness;
            let (choice, cover) = state.drawn_for(choice, &group.levels, &presences);
            if is_fresh || (state.choice, state.cover) != (Some(choice), cover) || state.is_veil_changed {
                (state.choice, state.cover) = (Some(choice), cover);
                state.is_veil_changed = false;
                show(&group.levels, &state, fade > 0.0, &mut members.ranges);
                veiled.extend(group.objects.iter().map(|object| (*object, Veil::of(choice))));
            }
            if let Ok(mut lods) = lods.get_mut(state.root) {
                report(group, state.main(choice), &mut lods);
            }
        }
        for (object, veil) in veiled {
            if let Ok((_, mut state, ..)) = groups.get_mut(object) {
                state.is_veil_changed |= state.veil != veil;
                state.veil = veil;
            }
        }
    }
}

/// The view of an active camera with a render target.
fn view((camera, transform): (&Camera, &GlobalTransform)) -> Option<View> {
    let height = camera.physical_viewport_size().filter(|_| camera.is_active)?.y;
    Some(View::new(transform.translation(), camera.clip_from_view(), height as f32))
}

/// What a game wants of a group.
#[derive(Clone, Copy)]
struct Wish {
    force: Option<u32>,
    bias: f32,
    enabled: bool,
}

impl Wish {
    /// The wishes for a scene, and those for an object of it: the object may force another level.
    fn of<'a>(lods: impl Iterator<Item = &'a SimpliguardLods>) -> Self {
        lods.fold(Self { force: None, bias: 1.0, enabled: true }, |all, own| Self {
            force: own.force.or(all.force),
            bias: own.bias * all.bias,
            enabled: own.enabled && all.enabled,
        })
    }
}

/// The conditions that decide on levels.
struct Selection<'a> {
    settings: &'a LodSettings,
    views: &'a [View],
}

impl Selection<'_> {
    /// The levels for a group, and its nearness.
    fn choice(
        &self,
        group: &LodGroup,
        state: &LodState,
        transform: &GlobalTransform,
        Wish { force, bias, enabled }: Wish,
    ) -> (Choice, Nearness) {
        if !self.settings.enabled || !enabled || state.is_source_cut {
            return (Choice::only(0), Nearness::Only(0));
        }
        if let Some(number) = self.settings.force.or(force) {
            // A level that is forced is one of the objects' own.
            let slot = if group.objects.is_empty() { forced(&group.levels, number) } else { 0 };
            return (Choice::only(slot), Nearness::Only(slot));
        }
        let current = state.choice.unwrap_or(Choice::only(0));
        if self.views.is_empty() {
            return (current, Nearness::Unknown);
        }
        let affine = transform.affine();
        let axes = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
        let radius = group.radius * axes.map(|axis| axis.length_squared()).into_iter().fold(0.0, f32::max).sqrt();
        let center = affine.transform_point3(group.center);
        let pixels = self.views.iter().map(|view| view.pixels_per_unit(center, radius)).fold(0.0, f32::max);
        // A bias on distances is one on sizes: the object counts as so much closer.
        let size = (2.0 * radius * pixels * (self.settings.bias * bias).max(0.0)).min(f32::MAX);
        let (pixel_error, fade) = (self.settings.pixel_error, self.settings.fade.clamp(0.0, 1.0));
        (choose(&state.rungs, size, pixel_error, fade, current.main()), Nearness::Size(size))
    }
}

/// Index of the level with this number, or of the next more detailed one.
fn forced(levels: &[LodLevel], number: u32) -> usize {
    let is_enough = |level: &LodLevel| number > 0 && level.level >= number;
    levels.iter().rposition(is_enough).unwrap_or(0)
}

/// Shows the selected levels as far as the veil leaves them, and hides all others of the group.
fn show(levels: &[LodLevel], state: &LodState, can_fade: bool, ranges: &mut Query<'_, '_, &mut VisibilityRange>) {
    let (choice, veil) = (state.choice.unwrap_or(Choice::only(0)), state.veil);
    let whole = if can_fade { Show::Whole } else { Show::Solid };
    for (slot, level) in levels.iter().enumerate() {
        let cover = state.cover.filter(|cover| cover.slot == slot);
        let show = match (veil, choice.next) {
            (Veil::None, _) if cover.is_some() => cover.map_or(whole, |cover| cover.show(choice, whole)),
            (Veil::Fading(step), _) if cover.is_some() => Show::FadeOut(step),
            (Veil::None, None) if slot == choice.slot => whole,
            (Veil::None, Some((_, step))) if slot == choice.slot => Show::FadeOut(step),
            (Veil::None, Some((next, step))) if slot == next => Show::FadeIn(step),
            (Veil::Fading(step), _) if slot == choice.main() => Show::FadeOut(step),
            _ => Show::Nothing,
        };
        let range = show.range();
        for primitive in &level.primitives {
            if let Ok(mut old) = ranges.get_mut(primitive.entity) {
                old.set_if_neq(range.clone());
            }
        }
    }
}

/// Updates the component that a game reads, if it differs.
fn report(group: &LodGroup, main: usize, lods: &mut Mut<'_, SimpliguardLods>) {
    if lods.levels.is_empty() {
        lods.levels.clone_from(&group.levels);
    }
    let current = group.levels.get(main).map_or(0, |level| level.level);
    if lods.current != current {
        lods.current = current;
    }
}
