//! Where things stand. Metres; `+Y` up, the visitor comes from `+Z`.

use bevy::prelude::*;

/// Largest width or depth of a model.
pub(crate) const FOOTPRINT: f32 = 1.7;
/// Largest height of a model.
pub(crate) const HEIGHT: f32 = 1.5;
/// Models that stand behind one another in an avenue.
pub(crate) const AVENUE: u16 = 16;
/// Radius of the plinth below each model.
pub(crate) const PLINTH_RADIUS: f32 = 1.0;
/// Height of the plinth below each model.
pub(crate) const PLINTH_HEIGHT: f32 = 0.1;

const COLUMN: f32 = 2.5;
/// Depth and height of a step of the gallery, which carries one model's levels.
pub(crate) const STEP: Vec2 = Vec2::new(2.8, 1.15);

/// A row's place in the gallery: its middle, on the step's floor.
pub(crate) fn row(model: usize) -> Vec3 {
    Vec3::new(0.0, model as f32 * STEP.y, -(model as f32) * STEP.x)
}

/// The place of column `index` of `count` in a model's row.
pub(crate) fn slot(model: usize, index: usize, count: usize) -> Vec3 {
    row(model) + Vec3::X * column(index, count)
}

/// Offset of a column from its row's middle.
fn column(index: usize, count: usize) -> f32 {
    (index as f32 - (count as f32 - 1.0) / 2.0) * COLUMN
}

/// Width of a row of `count` columns, with a margin.
pub(crate) fn row_width(count: usize) -> f32 {
    count as f32 * COLUMN + 0.5
}

/// The place of number `index` of a model's avenue. Avenues run beside the gallery, alternately right and left, and their
/// gaps grow with the distance, so that all of it can be seen from the front.
pub(crate) fn avenue(model: usize, index: u16) -> Vec3 {
    let side = if model.is_multiple_of(2) { 1.0 } else { -1.0 };
    let lane = (model / 2) as f32;
    let step = f32::from(index);
    Vec3::new(side * (7.6 + lane * 2.8), 0.0, 1.0 - 2.6 * step - 0.34 * step * step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_centred_and_rise_to_the_back() {
        assert_eq!(slot(0, 0, 1), Vec3::ZERO);
        assert_eq!(slot(0, 0, 4).x, -slot(0, 3, 4).x);
        assert!(row(1).y > row(0).y && row(1).z < row(0).z);
    }

    #[test]
    fn plinths_keep_apart() {
        let avenues = (0..4).flat_map(|model| (0..AVENUE).map(move |index| avenue(model, index)));
        let gallery = (0..4).flat_map(|model| (0..4).map(move |index| slot(model, index, 4)));
        let places: Vec<_> = avenues.chain(gallery).collect();
        for (i, a) in places.iter().enumerate() {
            for b in &places[..i] {
                assert!(a.distance(*b) > 2.0 * PLINTH_RADIUS, "{a} {b}");
            }
        }
    }
}
