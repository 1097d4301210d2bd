//! Gives all models a common size: a glTF file's units are metres by definition and anything in practice.

use bevy::camera::primitives::MeshAabb;
use bevy::camera::visibility::Visibility;
use bevy::prelude::*;
use bevy::world_serialization::WorldInstanceReady;

use crate::exhibits::{Collection, Exhibit, Pinned};
use crate::layout;

/// Per model, the transform from its own units to its place on a plinth; `None` until it is measured.
#[derive(Resource, Default)]
struct Fits(Vec<Option<Transform>>);

/// A source instance that appeared, or was replaced after a change of its file, since its model was measured.
#[derive(Component)]
struct Unmeasured;

pub(crate) fn plugin(app: &mut App) {
    app.init_resource::<Fits>().add_observer(note).add_systems(Update, (measure, apply).chain());
}

/// One instance of a model stands for all: the one in the gallery that shows the source.
fn note(ready: On<WorldInstanceReady>, mut commands: Commands, pinned: Query<&Pinned, With<Exhibit>>) {
    if pinned.get(ready.entity).is_ok_and(|level| level.0 == 0) {
        commands.entity(ready.entity).insert(Unmeasured);
    }
}

/// Measures new instances. Global transforms below them may not be known yet.
#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn measure(
    mut commands: Commands,
    mut fits: ResMut<Fits>,
    collection: Res<Collection>,
    meshes: Res<Assets<Mesh>>,
    unmeasured: Query<(Entity, &Exhibit), With<Unmeasured>>,
    children: Query<&Children>,
    parts: Query<&Mesh3d>,
    transforms: TransformHelper,
) {
    for (root, exhibit) in &unmeasured {
        let place = |entity| transforms.compute_global_transform(entity).map(|global| global.affine());
        let Ok(to_root) = place(root).map(|frame| frame.inverse()) else { continue };
        let boxes = children.iter_descendants(root).filter_map(|part| {
            let (mesh, transform) = (parts.get(part).ok()?, place(part).ok()?);
            // The mesh's own box, which no animation moves: every instance gets the same size.
            let bounds = meshes.get(mesh)?.compute_aabb()?;
            Some(corners(bounds.min().into(), bounds.max().into()).map(|c| (to_root * transform).transform_point3(c)))
        });
        let fit = fit(boxes.flatten());
        fits.0.resize(collection.models.len(), None);
        fits.0[exhibit.0] = Some(fit);
        commands.entity(root).remove::<Unmeasured>();
    }
}

fn apply(fits: Res<Fits>, mut exhibits: Query<(&Exhibit, &mut Transform, &mut Visibility)>) {
    for (exhibit, mut transform, mut visibility) in &mut exhibits {
        if let Some(Some(fit)) = fits.0.get(exhibit.0) {
            transform.set_if_neq(*fit);
            visibility.set_if_neq(Visibility::Inherited);
        }
    }
}

fn corners(min: Vec3, max: Vec3) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { min[axis] } else { max[axis] };
        Vec3::new(pick(0), pick(1), pick(2))
    })
}

/// Scales `points` into the layout's footprint and height and stands them in the middle of a plinth.
fn fit(points: impl Iterator<Item = Vec3>) -> Transform {
    let (min, max) = points.fold((Vec3::MAX, Vec3::MIN), |(min, max), p| (min.min(p), max.max(p)));
    let size = max - min;
    let scale = (layout::FOOTPRINT / size.x.max(size.z)).min(layout::HEIGHT / size.y);
    if !(scale > 0.0 && scale.is_finite()) {
        return Transform::IDENTITY;
    }
    let foot = Vec3::new((min.x + max.x) / 2.0, min.y, (min.z + max.z) / 2.0);
    Transform::from_translation(Vec3::Y * (layout::PLINTH_HEIGHT / 2.0) - foot * scale).with_scale(Vec3::splat(scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_stands_on_its_plinth() {
        let fit = fit(corners(Vec3::new(10.0, -4.0, 0.0), Vec3::new(14.0, -2.0, 2.0)).into_iter());
        let foot = fit.transform_point(Vec3::new(12.0, -4.0, 1.0));
        assert!(foot.distance(Vec3::Y * layout::PLINTH_HEIGHT / 2.0) < 1e-5);
        assert!((fit.scale.x * 4.0 - layout::FOOTPRINT).abs() < 1e-5);
    }

    #[test]
    fn height_limits_tall_models() {
        let fit = fit(corners(Vec3::ZERO, Vec3::new(1.0, 30.0, 1.0)).into_iter());
        assert!((fit.scale.y * 30.0 - layout::HEIGHT).abs() < 1e-5);
    }

    #[test]
    fn a_model_without_extent_stays_as_it_is() {
        assert_eq!(fit(std::iter::empty()), Transform::IDENTITY);
        assert_eq!(fit([Vec3::ONE].into_iter()), Transform::IDENTITY);
    }
}
