//! `--screenshot DIR` of the small examples: pictures of the window, each in the moment it waits for, and the end.

use std::env;
use std::path::PathBuf;

use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk};
use bevy_simpliguard::SimpliguardLods;

/// Frames between a model's levels and the picture: shaders and textures come a few frames late.
const SETTLED: u32 = 30;

/// The pictures that are asked for.
#[derive(Resource)]
struct Album {
    folder: PathBuf,
    left: usize,
}

pub(crate) trait Pictures {
    /// Takes the picture `NAME.png` once `when` holds, if `--screenshot` is given. The game ends after the last one.
    fn picture<M>(&mut self, name: &'static str, when: impl SystemCondition<M>) -> &mut Self;
}

impl Pictures for App {
    fn picture<M>(&mut self, name: &'static str, when: impl SystemCondition<M>) -> &mut Self {
        let mut args = env::args_os().skip_while(|arg| arg != "--screenshot").skip(1);
        let Some(folder) = args.next().map(PathBuf::from) else { return self };
        if !self.world().contains_resource::<Album>() {
            self.insert_resource(Album { folder, left: 0 }).add_observer(end_with_the_last);
        }
        self.world_mut().resource_mut::<Album>().left += 1;
        let take = move |mut commands: Commands, album: Res<Album>, mut taken: Local<bool>| {
            if !std::mem::replace(&mut taken, true) {
                let path = album.folder.join(name).with_extension("png");
                let _ = std::fs::create_dir_all(&album.folder);
                commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
            }
        };
        self.add_systems(Last, take.run_if(when))
    }
}

fn end_with_the_last(_: On<ScreenshotCaptured>, mut album: ResMut<Album>, mut exit: MessageWriter<AppExit>) {
    album.left -= 1;
    if album.left == 0 {
        exit.write(AppExit::Success);
    }
}

/// Whether every model has its levels, and is drawn.
pub(crate) fn all_have_levels(
    models: Query<Option<&SimpliguardLods>, With<WorldAssetRoot>>,
    mut frames: Local<u32>,
) -> bool {
    let complete = models.iter().all(|lods| lods.is_some_and(|lods| !lods.levels.is_empty()));
    *frames = if complete { *frames + 1 } else { 0 };
    *frames > SETTLED
}
