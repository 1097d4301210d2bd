//! Captions below the gallery's exhibits: the model, the level and its number of triangles.

use bevy::camera::visibility::Visibility;
use bevy::prelude::*;

use crate::exhibits::{Collection, Exhibit, Pinned};
use crate::layout::PLINTH_RADIUS;
use crate::markers;

/// Farthest distance at which a caption is shown, in metres.
const READABLE: f32 = 24.0;

/// Width of a caption's box in pixels, which its text is centred in.
const WIDTH: f32 = 180.0;

/// The exhibit that a caption belongs to.
#[derive(Component)]
struct Caption(Entity);

/// The text of an exhibit's caption.
#[derive(Component)]
struct CaptionText(Entity);

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
                Node { padding: UiRect::axes(px(7), px(2)), border_radius: BorderRadius::all(px(4)), ..default() },
                BackgroundColor(Color::srgba(0.10, 0.11, 0.12, 0.72)),
                children![(
                    CaptionText(entity),
                    Text::default(),
                    TextFont::from_font_size(13.0),
                    TextColor(markers::color(level.0)),
                )],
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
        let Ok((exhibit, level)) = exhibits.get(caption.0) else { continue };
        let model = &collection.models[exhibit.0];
        let name = if level.0 == 0 { model.name.replace('_', " ") } else { format!("LOD{}", level.0) };
        let known = model.levels.iter().find(|known| known.number == level.0);
        let triangles = known.map(|known| thousands(u64::from(known.triangles))).unwrap_or_default();
        text.set_if_neq(Text(format!("{name} {triangles}").trim_end().into()));
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
    camera: Single<(&Camera, &Transform), With<Camera3d>>,
    plinths: Query<&Transform, Without<Camera3d>>,
    parents: Query<&ChildOf>,
    mut captions: Query<(&Caption, &mut Node, &mut Visibility)>,
) {
    let (camera, eye) = camera.into_inner();
    let eye_frame = GlobalTransform::from(*eye);
    for (caption, mut node, mut visibility) in &mut captions {
        let place = parents.get(caption.0).and_then(|plinth| plinths.get(plinth.parent()));
        let edge = place.map(|plinth| plinth.translation + Vec3::Z * (PLINTH_RADIUS + 0.1)).ok();
        let shown = edge
            .filter(|edge| edge.distance(eye.translation) < READABLE)
            .and_then(|edge| camera.world_to_viewport(&eye_frame, edge).ok());
        if let Some(at) = shown {
            node.left = px(at.x - WIDTH / 2.0);
            node.top = px(at.y);
        }
        visibility.set_if_neq(if shown.is_some() { Visibility::Inherited } else { Visibility::Hidden });
    }
}

/// `number` with a comma between groups of three digits.
pub(crate) fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::thousands;

    #[test]
    fn digits_come_in_groups_of_three() {
        assert_eq!(thousands(0), "0");
        assert_eq!(thousands(999), "999");
        assert_eq!(thousands(1_000), "1,000");
        assert_eq!(thousands(12_345_678), "12,345,678");
    }
}
