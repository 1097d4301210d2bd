//! The panel in an app without a window: its entities, texts and keys.

use bevy::prelude::*;

use super::figures::{LegendEntry, Mode};
use super::panel::Panel;
use super::{OverlayCorner, OverlayPlugin, OverlaySettings};
use crate::lod::{LodGroup, LodLevel, LodLevelStats, LodSettings, LodStats};

fn app() -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, OverlayPlugin::default()));
    app.update();
    app
}

fn press(app: &mut App, key: KeyCode) {
    let mut keys = app.world_mut().resource_mut::<ButtonInput<KeyCode>>();
    keys.clear();
    keys.press(key);
    app.update();
    app.world_mut().resource_mut::<ButtonInput<KeyCode>>().release(key);
}

fn entities(app: &mut App) -> usize {
    let world = app.world_mut();
    world.query_filtered::<(), Or<(With<Node>, With<Text>)>>().iter(world).count()
}

fn lods(app: &App) -> &LodSettings {
    app.world().resource::<LodSettings>()
}

#[test]
fn hidden_there_is_nothing_of_it() {
    let mut app = app();
    assert!(entities(&mut app) > 0);
    press(&mut app, KeyCode::F3);
    assert_eq!(entities(&mut app), 0);
    press(&mut app, KeyCode::Digit1);
    assert_eq!(lods(&app).force, None);
    press(&mut app, KeyCode::F3);
    assert!(entities(&mut app) > 0);
}

#[test]
fn keys_choose_levels() {
    let mut app = app();
    press(&mut app, KeyCode::Digit3);
    assert_eq!(lods(&app).force, Some(3));
    press(&mut app, KeyCode::Digit0);
    assert_eq!(lods(&app).force, Some(0));
    press(&mut app, KeyCode::KeyA);
    assert_eq!(lods(&app).force, None);
    press(&mut app, KeyCode::KeyL);
    assert!(!lods(&app).enabled);
    let biases = [(); 4].map(|()| {
        press(&mut app, KeyCode::KeyB);
        lods(&app).bias
    });
    assert_eq!(biases, [2.0, 4.0, 0.5, 1.0]);
}

#[test]
fn without_keys_nothing_is_pressed() {
    let mut app = app();
    let before = lods(&app).clone();
    let mut settings = app.world_mut().resource_mut::<OverlaySettings>();
    settings.keys = super::OverlayKeys { toggle: None, levels: Vec::new(), automatic: None, enabled: None, bias: None };
    for key in [KeyCode::F3, KeyCode::Digit1, KeyCode::KeyA, KeyCode::KeyL, KeyCode::KeyB] {
        press(&mut app, key);
    }
    assert_eq!(*lods(&app), before);
    assert!(app.world().resource::<OverlaySettings>().visible);
}

#[test]
fn it_moves_to_another_corner() {
    let mut app = app();
    app.world_mut().resource_mut::<OverlaySettings>().corner = OverlayCorner::BottomRight;
    app.update();
    let world = app.world_mut();
    let node = world.query_filtered::<&Node, With<Panel>>().single(world).expect("one panel");
    assert_eq!((node.left, node.top), (auto(), auto()));
    assert!(node.right != auto() && node.bottom != auto());
}

#[test]
fn it_says_how_many_instances_show_each_level() {
    let mut app = app();
    let level =
        |level| LodLevel { level, budget: 9, faces: 9, error: 0.0, primitives: Vec::new(), textures: Vec::new() };
    app.world_mut().spawn(LodGroup {
        object: String::new(),
        center: Vec3::ZERO,
        radius: 1.0,
        levels: vec![level(0), level(2), level(1)],
        objects: Vec::new(),
    });
    let groups = |groups| LodLevelStats { groups, triangles: 0 };
    app.world_mut().insert_resource(LodStats { levels: vec![groups(1), groups(1_234)], ..default() });
    app.update();
    let world = app.world_mut();
    let mut entries = world.query::<(&LegendEntry, &Node, &Children)>();
    let mut shown: Vec<(u32, String)> = entries
        .iter(world)
        .filter(|(_, node, _)| node.display != Display::None)
        .map(|(entry, _, children)| {
            let text = children.iter().find_map(|child| world.get::<Text>(child)).expect("a text");
            (entry.0, text.0.clone())
        })
        .collect();
    shown.sort();
    let expected = [(0, "source 1"), (1, "LOD1 1,234"), (2, "LOD2 0")];
    assert_eq!(shown, expected.map(|(level, text)| (level, text.to_owned())));
}

#[test]
fn it_says_how_levels_are_chosen() {
    let mut app = app();
    let mut mode = |settings: LodSettings| {
        app.world_mut().insert_resource(settings);
        app.update();
        let world = app.world_mut();
        world.query_filtered::<&Text, With<Mode>>().single(world).expect("a line").0.clone()
    };
    assert_eq!(mode(LodSettings { bias: 2.0, ..default() }), "levels by distance: 1 px, bias 2");
    assert_eq!(mode(LodSettings { force: Some(0), ..default() }), "the source everywhere");
    assert_eq!(mode(LodSettings { force: Some(2), ..default() }), "LOD2 everywhere");
    assert_eq!(mode(LodSettings { enabled: false, force: Some(2), ..default() }), "levels off: the source everywhere");
}
