//! A camera on a sphere around a point of interest.

use std::f32::consts::{FRAC_PI_2, PI};

use bevy::input::mouse::{AccumulatedMouseMotion, AccumulatedMouseScroll, MouseScrollUnit};
use bevy::prelude::*;

use crate::exhibits::Collection;
use crate::layout;

/// Where the camera is. Angles in radians, `yaw` from `+Z` to `+X`, `pitch` up; lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    pub(crate) focus: Vec3,
    pub(crate) yaw: f32,
    pub(crate) pitch: f32,
    pub(crate) distance: f32,
}

/// A camera that glides to where the visitor wants it.
#[derive(Component)]
pub(crate) struct Orbit {
    pub(crate) shown: View,
    pub(crate) wanted: View,
}

impl Orbit {
    /// A camera that is where `view` says.
    pub(crate) fn looking(view: View) -> (Self, Transform) {
        (Self { shown: view, wanted: view }, view.transform())
    }

    /// Puts the camera there at once.
    pub(crate) fn jump(&mut self, view: View) {
        (self.shown, self.wanted) = (view, view);
    }
}

impl View {
    fn transform(self) -> Transform {
        let rotation = Quat::from_euler(EulerRot::YXZ, self.yaw, -self.pitch, 0.0);
        Transform { translation: self.focus + rotation * (Vec3::Z * self.distance), rotation, ..default() }
    }

    /// The view on the way to `other`, `t` in 0..=1.
    fn towards(self, other: Self, t: f32) -> Self {
        Self {
            focus: self.focus.lerp(other.focus, t),
            yaw: self.yaw.lerp(other.yaw, t),
            pitch: self.pitch.lerp(other.pitch, t),
            // Each step scales the picture by the same factor.
            distance: self.distance * (other.distance / self.distance).powf(t),
        }
    }

    fn clamped(mut self) -> Self {
        self.pitch = self.pitch.clamp(-0.05, FRAC_PI_2 - 0.05);
        self.distance = self.distance.clamp(1.0, 250.0);
        self.focus.y = self.focus.y.clamp(0.0, 20.0);
        self
    }
}

impl Collection {
    /// Places worth looking from, with their names: everything, each model's row, the avenues.
    pub(crate) fn views(&self) -> Vec<(String, View)> {
        let count = self.models.len();
        let last = layout::row(count.saturating_sub(1));
        let middle = last / 2.0 + Vec3::Y * 0.9;
        let all = View { focus: middle, yaw: 0.0, pitch: 0.42, distance: 13.0 + 1.2 * count as f32 };
        let rows = self.models.iter().enumerate().map(|(index, model)| {
            let focus = layout::row(index) + Vec3::Y * 0.6;
            (model.name.clone(), View { focus, yaw: 0.06, pitch: 0.34, distance: 7.4 })
        });
        // From behind the gallery.
        let avenues = View { focus: layout::avenue(0, 4) + Vec3::X * 1.4, yaw: -0.12, pitch: 0.24, distance: 8.5 };
        std::iter::once(("everything".into(), all)).chain(rows).chain([("avenue".into(), avenues)]).collect()
    }
}

/// Number of the view that `Tab` chose last.
#[derive(Resource, Default)]
struct ViewChoice(usize);

pub(crate) fn plugin(app: &mut App) {
    app.init_resource::<ViewChoice>();
    app.add_systems(Update, (choose, keys, mouse, glide).chain());
}

fn choose(
    keys: Res<ButtonInput<KeyCode>>,
    collection: Res<Collection>,
    mut choice: ResMut<ViewChoice>,
    mut orbit: Single<&mut Orbit>,
) {
    if keys.just_pressed(KeyCode::Tab) {
        let views = collection.views();
        let back = keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
        choice.0 = (choice.0 + if back { views.len() - 1 } else { 1 }) % views.len();
        orbit.wanted = views[choice.0].1;
    }
}

fn keys(keys: Res<ButtonInput<KeyCode>>, time: Res<Time>, mut orbit: Single<&mut Orbit>) {
    let axis = |more, less| f32::from(i8::from(keys.pressed(more)) - i8::from(keys.pressed(less))) * time.delta_secs();
    let yaw = axis(KeyCode::ArrowRight, KeyCode::ArrowLeft);
    let pitch = axis(KeyCode::ArrowUp, KeyCode::ArrowDown);
    let zoom = axis(KeyCode::PageDown, KeyCode::PageUp);
    if [yaw, pitch, zoom] != [0.0; 3] {
        let wanted = orbit.wanted;
        orbit.wanted = View {
            yaw: wanted.yaw + yaw * 1.5,
            pitch: wanted.pitch + pitch,
            distance: wanted.distance * (zoom * 1.5).exp(),
            ..wanted
        }
        .clamped();
    }
}

fn mouse(
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    scroll: Res<AccumulatedMouseScroll>,
    window: Single<&Window>,
    mut orbit: Single<&mut Orbit>,
) {
    let mut wanted = orbit.wanted;
    // A drag across the window's height is half a turn.
    let drag = motion.delta / window.height();
    if buttons.pressed(MouseButton::Left) {
        wanted.yaw -= drag.x * PI;
        wanted.pitch += drag.y * PI;
    } else if buttons.any_pressed([MouseButton::Right, MouseButton::Middle]) {
        let rotation = wanted.transform().rotation;
        wanted.focus += rotation * Vec3::new(-drag.x, drag.y, 0.0) * wanted.distance;
    }
    let lines = match scroll.unit {
        MouseScrollUnit::Line => scroll.delta.y,
        MouseScrollUnit::Pixel => scroll.delta.y / 40.0,
    };
    wanted.distance *= (-0.12 * lines).exp();
    if wanted != orbit.wanted {
        orbit.wanted = wanted.clamped();
    }
}

fn glide(time: Res<Time>, camera: Single<(&mut Orbit, &mut Transform)>) {
    let (mut orbit, mut transform) = camera.into_inner();
    if orbit.shown != orbit.wanted {
        let t = 1.0 - (-10.0 * time.delta_secs()).exp();
        orbit.shown = orbit.shown.towards(orbit.wanted, t);
        // Gliding never quite arrives.
        if orbit.shown.focus.distance(orbit.wanted.focus) < 1e-4 {
            orbit.shown = orbit.shown.towards(orbit.wanted, 1.0);
        }
    }
    transform.set_if_neq(orbit.shown.transform());
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: View = View { focus: Vec3::new(1.0, 2.0, 3.0), yaw: 0.0, pitch: 0.0, distance: 4.0 };

    #[test]
    fn the_camera_looks_at_its_focus() {
        assert!(VIEW.transform().translation.distance(Vec3::new(1.0, 2.0, 7.0)) < 1e-5);
        let view = View { yaw: 1.0, pitch: 0.5, ..VIEW };
        let seen = view.transform();
        let forward = (view.focus - seen.translation) / view.distance;
        assert!(seen.forward().distance(forward) < 1e-5);
        assert!(seen.translation.y > view.focus.y && seen.translation.x > view.focus.x);
    }

    #[test]
    fn gliding_ends_where_it_should() {
        let other = View { distance: 16.0, yaw: 1.0, ..VIEW };
        assert!((VIEW.towards(other, 0.5).distance - 8.0).abs() < 1e-4);
        assert!((VIEW.towards(other, 1.0).distance - 16.0).abs() < 1e-4);
    }
}
