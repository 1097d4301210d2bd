//! Pictures of the game from near, the middle and afar, for looking at and for documentation.

use std::collections::VecDeque;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk};
use bevy_simpliguard::Bakes;

use crate::camera::{Orbit, View};
use crate::exhibits::{Collection, Pinned};
use crate::help::Help;

/// Frames between a move of the camera and the picture: shaders and textures come a few frames late.
const SETTLED: u32 = 8;

/// Time without a change after which the models count as complete: an exchanged file is loaded again within it.
const QUIET: Duration = Duration::from_secs(4);

/// Longest wait for the models.
const PATIENCE: Duration = Duration::from_secs(30 * 60);

/// The pictures to take.
#[derive(Resource)]
struct Album {
    folder: PathBuf,
    left: VecDeque<(String, View)>,
    taken: Vec<PathBuf>,
    step: Step,
    start: Instant,
}

enum Step {
    /// Nothing has changed since then, or something is not there yet.
    Waiting(Option<Instant>),
    /// The camera goes on to the next picture.
    Moving,
    /// Frames since the camera moved.
    Settling(u32),
    /// The picture is being taken.
    Exposing,
}

/// Writes pictures to `folder` once the models are complete, then ends the game.
pub(crate) fn plugin(folder: PathBuf) -> impl Plugin {
    move |app: &mut App| {
        app.insert_resource(Album {
            folder: folder.clone(),
            left: VecDeque::new(),
            taken: Vec::new(),
            step: Step::Waiting(None),
            start: Instant::now(),
        });
        app.add_systems(Update, (wait, take).chain()).add_systems(PostStartup, hide_help).add_observer(taken);
    }
}

/// The keys are of no use in a picture.
fn hide_help(mut help: Single<&mut Node, With<Help>>) {
    help.display = Display::None;
}

fn wait(
    mut album: ResMut<Album>,
    collection: Res<Collection>,
    bakes: Res<Bakes>,
    exhibits: Query<&Visibility, With<Pinned>>,
    mut exit: MessageWriter<AppExit>,
) {
    let Step::Waiting(quiet) = album.step else { return };
    let changed = collection.is_changed() || bakes.is_changed() || !bakes.is_settled();
    if changed || exhibits.iter().any(|visibility| *visibility == Visibility::Hidden) {
        album.step = Step::Waiting(None);
    } else if quiet.is_none_or(|since| since.elapsed() < QUIET) {
        album.step = Step::Waiting(quiet.or(Some(Instant::now())));
    } else {
        album.left = pictures(&collection);
        album.step = Step::Moving;
    }
    if album.start.elapsed() > PATIENCE {
        error!("no pictures: the models were not complete after {} s", PATIENCE.as_secs());
        exit.write(AppExit::error());
    }
}

fn take(
    mut commands: Commands,
    mut album: ResMut<Album>,
    mut orbit: Single<&mut Orbit>,
    mut exit: MessageWriter<AppExit>,
) {
    match album.step {
        Step::Moving => match album.left.front() {
            Some((_, view)) => {
                orbit.jump(*view);
                album.step = Step::Settling(0);
            }
            None => {
                let complete = album.taken.iter().all(|picture| picture.is_file());
                exit.write(if complete { AppExit::Success } else { AppExit::error() });
            }
        },
        Step::Settling(frames) if frames < SETTLED => album.step = Step::Settling(frames + 1),
        Step::Settling(_) => {
            if let Err(error) = fs::create_dir_all(&album.folder) {
                error!("{}: {error}", album.folder.display());
            }
            let name = album.left.pop_front().map_or_else(String::new, |(name, _)| name);
            let path = album.folder.join(format!("{name}.png"));
            commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path.clone()));
            album.taken.push(path);
            album.step = Step::Exposing;
        }
        Step::Waiting(_) | Step::Exposing => {}
    }
}

fn taken(_: On<ScreenshotCaptured>, mut album: ResMut<Album>) {
    album.step = Step::Moving;
}

/// Near: each model's row. Middle: everything. Far: the avenues.
fn pictures(collection: &Collection) -> VecDeque<(String, View)> {
    let views = collection.views();
    let last = views.len() - 1;
    let name = |(index, (name, view)): (usize, (String, View))| match index {
        0 => ("middle".into(), view),
        _ if index == last => ("far".into(), view),
        _ => (format!("near_{name}"), view),
    };
    views.into_iter().enumerate().map(name).collect()
}
