//! The panel in the corner: what is drawn, what is forced, what is being baked, and the keys.

use std::collections::BTreeMap;

use bevy::diagnostic::{DiagnosticsStore, FrameTimeDiagnosticsPlugin};
use bevy::prelude::*;
use bevy_simpliguard::{BakeFailed, BakeFinished, BakeProgress, BakeStarted, LodSettings, LodStats, SimpliguardLods};

use crate::controls::{Choice, KEYS};
use crate::exhibits::Exhibit;
use crate::labels::thousands;
use crate::markers::{self, LEVELS};

/// Bakes that run, and those that failed, by the model's path.
#[derive(Resource, Default)]
pub(crate) struct Bakes {
    pub(crate) running: BTreeMap<String, (String, f32)>,
    pub(crate) failed: BTreeMap<String, String>,
}

#[derive(Component)]
struct Figures;

#[derive(Component)]
struct Mode;

/// The legend's entry for a level.
#[derive(Component)]
struct LegendEntry(u32);

#[derive(Component)]
struct BakeLines;

#[derive(Component)]
pub(crate) struct Help;

const TEXT: Color = Color::srgb(0.94, 0.94, 0.92);
const DIM: Color = Color::srgb(0.70, 0.71, 0.72);

pub(crate) fn plugin(app: &mut App) {
    app.init_resource::<Bakes>();
    app.add_systems(Startup, (panel, help));
    app.add_systems(Update, (follow_bakes, (figures, mode, legend, bake_lines)).chain());
    app.add_systems(Update, toggle_help);
}

fn panel(mut commands: Commands) {
    let entries: Vec<Entity> = (0..=LEVELS as u32).map(|level| commands.spawn(legend_entry(level)).id()).collect();
    let legend =
        commands.spawn(Node { column_gap: px(14), flex_wrap: FlexWrap::Wrap, ..default() }).add_children(&entries).id();
    let figures = commands.spawn((Figures, line(17.0, TEXT))).id();
    let mode = commands.spawn((Mode, line(14.0, DIM))).id();
    let bakes = commands.spawn((BakeLines, line(14.0, Color::srgb(0.97, 0.79, 0.40)))).id();
    commands.spawn(boxed(px(14), auto())).add_children(&[figures, legend, mode, bakes]);
}

/// A panel at the left, `top` or `bottom` pixels from the window's edge.
fn boxed(top: Val, bottom: Val) -> impl Bundle {
    (
        Node {
            position_type: PositionType::Absolute,
            left: px(14),
            top,
            bottom,
            padding: UiRect::axes(px(14), px(10)),
            row_gap: px(6),
            flex_direction: FlexDirection::Column,
            border_radius: BorderRadius::all(px(8)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.10, 0.11, 0.12, 0.78)),
    )
}

fn line(size: f32, color: Color) -> impl Bundle {
    (Text::default(), TextFont::from_font_size(size), TextColor(color))
}

fn legend_entry(level: u32) -> impl Bundle {
    (
        LegendEntry(level),
        Node { column_gap: px(6), align_items: AlignItems::Center, display: Display::None, ..default() },
        children![
            (
                Node { width: px(12), height: px(12), border_radius: BorderRadius::all(px(3)), ..default() },
                BackgroundColor(markers::color(level)),
            ),
            line(14.0, TEXT),
        ],
    )
}

fn help(mut commands: Commands) {
    let keys = KEYS.map(|(key, _)| key).join("\n");
    let meanings = KEYS.map(|(_, meaning)| meaning).join("\n");
    commands.spawn((Help, boxed(auto(), px(14)))).with_children(|panel| {
        panel.spawn(Node { column_gap: px(18), ..default() }).with_children(|columns| {
            columns.spawn((Text::new(keys), TextFont::from_font_size(13.0), TextColor(TEXT)));
            columns.spawn((Text::new(meanings), TextFont::from_font_size(13.0), TextColor(DIM)));
        });
    });
}

fn toggle_help(keys: Res<ButtonInput<KeyCode>>, mut help: Single<&mut Node, With<Help>>) {
    if keys.just_pressed(KeyCode::KeyH) {
        help.display = if help.display == Display::None { Display::Flex } else { Display::None };
    }
}

fn follow_bakes(
    mut bakes: ResMut<Bakes>,
    mut started: MessageReader<BakeStarted>,
    mut progress: MessageReader<BakeProgress>,
    mut finished: MessageReader<BakeFinished>,
    mut failed: MessageReader<BakeFailed>,
) {
    for bake in started.read() {
        bakes.failed.remove(&bake.path.to_string());
        bakes.running.insert(bake.path.to_string(), (String::new(), 0.0));
    }
    for bake in progress.read() {
        bakes.running.insert(bake.path.to_string(), (bake.stage.to_string(), bake.fraction));
    }
    for bake in finished.read() {
        bakes.running.remove(&bake.path.to_string());
    }
    for bake in failed.read() {
        bakes.running.remove(&bake.path.to_string());
        bakes.failed.insert(bake.path.to_string(), bake.error.clone());
    }
}

fn figures(mut text: Single<&mut Text, With<Figures>>, stats: Res<LodStats>, diagnostics: Res<DiagnosticsStore>) {
    let fps = diagnostics.get(&FrameTimeDiagnosticsPlugin::FPS).and_then(|fps| fps.smoothed()).unwrap_or(0.0);
    let (drawn, source) = (stats.triangles, stats.source_triangles);
    let percent = 100.0 * drawn as f64 / source.max(1) as f64;
    let digits = usize::from(fps < 10.0);
    let line = format!("{} of {} triangles ({percent:.1} %)   {fps:.digits$} fps", thousands(drawn), thousands(source));
    text.set_if_neq(Text(line));
}

fn mode(mut text: Single<&mut Text, With<Mode>>, choice: Res<Choice>, settings: Res<LodSettings>) {
    let levels = match choice.forced {
        _ if !settings.enabled => "levels off: the source everywhere".into(),
        Some(0) => "the source everywhere".into(),
        Some(level) => format!("LOD{level} everywhere"),
        None => "levels by distance".into(),
    };
    let line = format!("{levels}, bias {}   H: keys", settings.bias);
    text.set_if_neq(Text(line));
}

/// Shows the levels that there are, and how many exhibits in view show each.
fn legend(
    mut entries: Query<(&LegendEntry, &mut Node, &Children)>,
    mut texts: Query<&mut Text>,
    stats: Res<LodStats>,
    exhibits: Query<&SimpliguardLods, With<Exhibit>>,
) {
    let highest = exhibits.iter().flat_map(|lods| &lods.levels).map(|level| level.level).max().unwrap_or(0);
    for (entry, mut node, children) in &mut entries {
        let display = if entry.0 <= highest { Display::Flex } else { Display::None };
        if node.display != display {
            node.display = display;
        }
        let name = if entry.0 == 0 { "source".into() } else { format!("LOD{}", entry.0) };
        let shown = stats.levels.get(entry.0 as usize).map_or(0, |level| level.groups);
        for child in children {
            if let Ok(mut text) = texts.get_mut(*child) {
                text.set_if_neq(Text(format!("{name} {shown}")));
            }
        }
    }
}

fn bake_lines(mut lines: Single<(&mut Text, &mut Node), With<BakeLines>>, bakes: Res<Bakes>) {
    let running = bakes.running.iter().map(|(path, (stage, fraction))| {
        let percent = (fraction * 100.0).round();
        format!("baking {path}: {percent} % {stage}")
    });
    let failed = bakes.failed.iter().map(|(path, error)| format!("{path}: {error}"));
    let text = running.chain(failed).collect::<Vec<_>>().join("\n");
    let display = if text.is_empty() { Display::None } else { Display::Flex };
    let (shown, node) = &mut *lines;
    shown.set_if_neq(Text(text));
    if node.display != display {
        node.display = display;
    }
}
