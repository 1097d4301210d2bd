//! Captions below the gallery's exhibits: the model, the level and its number of triangles.

use std::ops::Range;

use bevy::camera::visibility::Visibility;
use bevy::prelude::*;
use bevy_simpliguard::overlay::{level_color, thousands};

use crate::camera::Orbit;
use crate::exhibits::{Collection, Exhibit, Pinned};
use crate::layout::PLINTH_RADIUS;

/// Depths at which captions are shown, as parts of the depth of what the camera looks at: captions of other rows would
/// cover it.
const IN_FOCUS: Range<f32> = 0.7..1.28;

/// Farthest distance at which captions tell the number of triangles, in metres.
const READABLE: f32 = 12.0;

/// Width of a caption's box in pixels, which its text is centred in.
const WIDTH: f32 = 180.0;

/// The exhibit that a caption belongs to.
#[derive(Component)]
struct Caption(Entity);

/// A caption's text: its exhibit's name, or its number of triangles.
#[derive(Component)]
enum CaptionText {
    Name(Entity),
    Triangles(Entity),
}

pub(crate) fn plugin(app: &mut App) {
    app.add_systems(Update, (hang, write, clean).chain());
    app.add_systems(PostUpdate, follow.before(bevy::ui::UiSystems::Layout));
}

fn hang(mut commands: Commands, exhibits: Query<(Entity, &Pinned), Added<Pinned>>) {
    for (entity, level) in &exhibits {
        commands.spawn((
            Caption(entity),
            Node {
                position_type: PositionType::Absolute,
                width: px(WIDTH),
                justify_content: JustifyContent::Center,
                ..default()
            },
            Visibility::Hidden,
            children![(
                Node {
                    padding: UiRect::new(px(7), px(7), px(2), px(3)),
                    border: UiRect::bottom(px(3)),
                    border_radius: BorderRadius::all(px(4)),
                    column_gap: px(6),
                    ..default()
                },
                BackgroundColor(Color::srgba(0.10, 0.11, 0.12, 0.78)),
                BorderColor::all(level_color(level.0)),
                children![
                    (CaptionText::Name(entity), Text::default(), TextFont::from_font_size(13.0)),
                    (
                        CaptionText::Triangles(entity),
                        Node::default(),
                        Text::default(),
                        TextFont::from_font_size(13.0),
                        TextColor(Color::srgb(0.75, 0.76, 0.77)),
                    ),
                ],
            )],
        ));
    }
}

fn write(
    mut texts: Query<(&CaptionText, &mut Text)>,
    exhibits: Query<(&Exhibit, &Pinned)>,
    collection: Res<Collection>,
) {
    for (caption, mut text) in &mut texts {
        let (CaptionText::Name(exhibit) | CaptionText::Triangles(exhibit)) = caption;
        let Ok((exhibit, level)) = exhibits.get(*exhibit) else { continue };
        let model = &collection.models[exhibit.0];
        let words = match caption {
            CaptionText::Name(_) if level.0 == 0 => model.name.replace('_', " "),
            CaptionText::Name(_) => format!("LOD{}", level.0),
            CaptionText::Triangles(_) => {
                let known = model.levels.iter().find(|known| known.number == level.0);
                known.map(|known| thousands(u64::from(known.triangles))).unwrap_or_default()
            }
        };
        text.set_if_neq(Text(words));
    }
}

fn clean(mut commands: Commands, captions: Query<(Entity, &Caption)>, mut gone: RemovedComponents<Pinned>) {
    for exhibit in gone.read() {
        for (entity, _) in captions.iter().filter(|(_, caption)| caption.0 == exhibit) {
            commands.entity(entity).despawn();
        }
    }
}

/// Keeps captions at the front edge of their plinths.
fn follow(
    camera: Single<(&Camera, &Transform, &Orbit)>,
    plinths: Query<&Transform, Without<Orbit>>,
    parents: Query<&ChildOf>,
    mut captions: Query<(&Caption, &mut Node, &mut Visibility), Without<CaptionText>>,
    mut texts: Query<(&CaptionText, &mut Node)>,
) {
    let (camera, eye, orbit) = camera.into_inner();
    let frame = GlobalTransform::from(*eye);
    for (caption, mut node, mut visibility) in &mut captions {
        let plinth = parents.get(caption.0).and_then(|plinth| plinths.get(plinth.parent()));
        let seen = plinth.ok().map(|plinth| plinth.translation).and_then(|middle| {
            let depth = (middle - eye.translation).dot(*eye.forward()) / orbit.shown.distance;
            let edge = middle + Vec3::Z * (PLINTH_RADIUS + 0.1);
            IN_FOCUS.contains(&depth).then(|| camera.world_to_viewport(&frame, edge).ok())?
        });
        if let Some(at) = seen {
            node.left = px(at.x - WIDTH / 2.0);
            node.top = px(at.y);
        }
        visibility.set_if_neq(if seen.is_some() { Visibility::Inherited } else { Visibility::Hidden });
    }
    let display = if orbit.shown.distance < READABLE { Display::Flex } else { Display::None };
    for (caption, mut node) in &mut texts {
        if matches!(caption, CaptionText::Triangles(_)) && node.display != display {
            node.display = display;
        }
    }
}
