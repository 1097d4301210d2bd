//! The panel's list of bakes.

use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::prelude::*;

use super::settings::OverlaySettings;
use super::style::{DIM, TEXT, text};
use crate::bake::{BakeStatus, Bakes};

/// Largest number of models in the list. Of the others, only the number is shown.
const ROWS: usize = 8;

/// Time for which the list stays after the last bake. Failures and warnings stay until they are corrected.
const LINGER: Duration = Duration::from_secs(5);

const RUNNING: Color = Color::srgb(0.97, 0.79, 0.40);
const DONE: Color = Color::srgb(0.45, 0.78, 0.50);
const FAILED: Color = Color::srgb(0.95, 0.48, 0.40);

/// The list in the panel, and its content.
#[derive(Component, Default)]
pub(super) struct BakeList {
    shown: List,
    /// Time of the last change of bakes, from the start of the game.
    changed: Option<Duration>,
}

#[derive(Default, PartialEq)]
struct List {
    rows: Vec<Row>,
    /// Number of models without a row.
    more: usize,
}

#[derive(Clone, PartialEq)]
struct Row {
    path: String,
    state: State,
}

#[derive(Clone, PartialEq)]
enum State {
    Baking {
        percent: u8,
        stage: String,
    },
    Failed(String),
    Queued,
    /// There are levels, but some hardly look like their source.
    Unlike(String),
    Done {
        tenths: u64,
        hint: Option<String>,
    },
}

/// Updates the list.
pub(super) fn list(
    mut commands: Commands<'_, '_>,
    list: Single<'_, '_, (Entity, &mut BakeList, &mut Node)>,
    bakes: Option<Res<'_, Bakes>>,
    settings: Res<'_, OverlaySettings>,
    time: Res<'_, Time<Real>>,
) {
    let Some(bakes) = bakes else { return };
    let (entity, mut list, mut node) = list.into_inner();
    if bakes.is_changed() {
        list.changed = Some(time.elapsed());
    }
    let is_busy = !bakes.is_settled() || list.changed.is_some_and(|at| time.elapsed() - at < LINGER);
    let wanted = List::of(bakes.iter(), is_busy);
    if list.shown != wanted {
        commands.entity(entity).despawn_children().with_children(|parent| wanted.spawn(parent, settings.text_size));
        node.display = if wanted.rows.is_empty() { Display::None } else { Display::Flex };
        list.shown = wanted;
    }
}

impl List {
    fn of<'a>(bakes: impl Iterator<Item = (&'a AssetPath<'static>, &'a BakeStatus)>, is_busy: bool) -> Self {
        let mut rows: Vec<Row> = bakes
            .filter_map(|(path, status)| Some(Row { path: path.to_string(), state: State::of(status)? }))
            .filter(|row| is_busy || matches!(row.state, State::Failed(_) | State::Unlike(_)))
            .collect();
        // Rows are not sorted by progress, so that they keep their places during a bake.
        rows.sort_by_key(|row| match row.state {
            State::Baking { .. } => 0,
            State::Failed(_) => 1,
            State::Unlike(_) => 2,
            State::Queued => 3,
            State::Done { .. } => 4,
        });
        let more = rows.len().saturating_sub(ROWS);
        rows.truncate(ROWS);
        Self { rows, more }
    }

    fn spawn(&self, parent: &mut ChildSpawnerCommands<'_>, size: f32) {
        for row in &self.rows {
            parent.spawn(Node { column_gap: px(size), align_items: AlignItems::Center, ..default() }).with_children(
                |parent| {
                    parent.spawn(text(&row.path, 0.9 * size, TEXT));
                    row.state.spawn(parent, 0.9 * size);
                },
            );
        }
        if self.more > 0 {
            parent.spawn(text(&format!("and {} more", self.more), 0.9 * size, DIM));
        }
    }
}

impl State {
    /// `None` for a result from the cache, which needs no row.
    fn of(status: &BakeStatus) -> Option<Self> {
        match status {
            BakeStatus::Queued => Some(Self::Queued),
            BakeStatus::Baking { stage, fraction } => {
                let percent = (100.0 * fraction.clamp(0.0, 1.0)) as u8;
                Some(Self::Baking { percent, stage: stage.to_string() })
            }
            BakeStatus::Done { warnings, .. } if !warnings.is_empty() => Some(Self::Unlike(warnings.join("\n"))),
            BakeStatus::Done { duration, .. } if duration.is_zero() => None,
            BakeStatus::Done { duration, hint, .. } => {
                Some(Self::Done { tenths: duration.as_millis() as u64 / 100, hint: hint.clone() })
            }
            BakeStatus::Failed { error } => Some(Self::Failed(error.clone())),
        }
    }

    fn spawn(&self, parent: &mut ChildSpawnerCommands<'_>, size: f32) {
        match self {
            Self::Baking { percent, stage } => {
                parent.spawn(bar(*percent, size));
                parent.spawn(text(&format!("{percent} % {stage}"), size, RUNNING));
            }
            Self::Failed(error) => {
                parent.spawn(text(error, size, FAILED));
            }
            Self::Unlike(warnings) => {
                parent.spawn(text(warnings, size, RUNNING));
            }
            Self::Queued => {
                parent.spawn(text("queued", size, DIM));
            }
            Self::Done { tenths, hint } => {
                parent.spawn(text(&format!("done in {}.{} s", tenths / 10, tenths % 10), size, DONE));
                if let Some(hint) = hint {
                    parent.spawn(text(hint, size, DIM));
                }
            }
        }
    }
}

fn bar(done: u8, size: f32) -> impl Bundle {
    let radius = BorderRadius::all(px(0.2 * size));
    (
        Node { width: px(8.0 * size), height: px(0.5 * size), border_radius: radius, flex_shrink: 0.0, ..default() },
        BackgroundColor(Color::srgba(1.0, 1.0, 1.0, 0.15)),
        children![(
            Node { width: percent(done), height: percent(100), border_radius: radius, ..default() },
            BackgroundColor(RUNNING),
        )],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hint_of_a_scene_stands_beside_the_time_of_its_bake() {
        let status = |hint: Option<&str>| BakeStatus::Done {
            duration: Duration::from_millis(1250),
            warnings: Vec::new(),
            hint: hint.map(str::to_owned),
        };
        assert!(State::of(&status(None)) == Some(State::Done { tenths: 12, hint: None }));
        let hint = Some("it looks like a scene".to_owned());
        assert!(State::of(&status(hint.as_deref())) == Some(State::Done { tenths: 12, hint }));
    }
}
