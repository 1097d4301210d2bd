//! The game's plugins, and opening it where that may be impossible.

use std::any::Any;
use std::env;
use std::panic::{self, AssertUnwindSafe};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bevy::app::TerminalCtrlCHandlerPlugin;
use bevy::asset::AssetMode;
use bevy::prelude::*;
use bevy::window::PresentMode;
use bevy_simpliguard::{OverlayPlugin, SimpliguardPlugin};

use crate::{camera, clips, exhibits, fit, help, labels, markers, photos, stage};

/// Builds the game, with a window and a renderer. `Err` says why there is none.
///
/// Bevy panics where no window system or no graphics adapter is found, both while plugins are built.
pub(crate) fn open(photos: Option<PathBuf>) -> Result<App, String> {
    if cfg!(target_os = "linux") && env::var_os("DISPLAY").is_none_or(|display| display.is_empty()) {
        return Err("no display: DISPLAY is not set".into());
    }
    let mut app = quietly(|| build(photos)).map_err(|panic| panic.lines().next().unwrap_or_default().to_owned())?;
    app.add_plugins(TerminalCtrlCHandlerPlugin);
    Ok(app)
}

fn build(photos: Option<PathBuf>) -> App {
    let mut app = App::new();
    let window = Window {
        title: "simpliguard".into(),
        // Pictures are smaller and taken as fast as they can be drawn: perhaps by a software renderer.
        resolution: if photos.is_some() { (1120, 630).into() } else { (1600, 900).into() },
        present_mode: if photos.is_some() { PresentMode::AutoNoVsync } else { PresentMode::AutoVsync },
        ..default()
    };
    app.add_plugins((
        SimpliguardPlugin::default(),
        DefaultPlugins
            .build()
            // A process has one handler, and where the game does not open it is the bake's.
            .disable::<TerminalCtrlCHandlerPlugin>()
            .set(AssetPlugin { mode: AssetMode::Processed, ..default() })
            .set(WindowPlugin { primary_window: Some(window), ..default() }),
        OverlayPlugin::default(),
    ));
    app.add_plugins((stage::plugin, exhibits::plugin, fit::plugin, clips::plugin, markers::plugin));
    app.add_plugins((camera::plugin, help::plugin, labels::plugin));
    if let Some(folder) = photos {
        app.add_plugins(photos::plugin(folder));
    }
    app
}

/// Runs `work`; a panic comes back as its message and prints nothing.
fn quietly<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    let quiet = Arc::new(AtomicBool::new(true));
    let default = panic::take_hook();
    let switch = Arc::clone(&quiet);
    panic::set_hook(Box::new(move |info| {
        if !switch.load(Ordering::Relaxed) {
            default(info);
        }
    }));
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    quiet.store(false, Ordering::Relaxed);
    result.map_err(|payload| message(payload.as_ref()))
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_its_message() {
        assert_eq!(quietly(|| 1), Ok(1));
        assert_eq!(quietly(|| -> () { panic!("no adapter") }), Err("no adapter".into()));
        let level = 3;
        assert_eq!(quietly(|| -> () { panic!("level {level}") }), Err("level 3".into()));
    }
}
