//! The models, and where each is shown: in a row of the gallery, one plinth per level, and in an avenue where the distance
//! chooses the level.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use bevy::camera::visibility::Visibility;
use bevy::gltf::{Gltf, GltfAssetLabel};
use bevy::prelude::*;
use bevy_simpliguard::SimpliguardLods;
use bevy_simpliguard::lod::LodGroup;

use crate::layout::{self, AVENUE};

/// One file of the asset folder.
pub(crate) struct Model {
    /// The file's name without its extension.
    pub(crate) name: String,
    pub(crate) gltf: Handle<Gltf>,
    scene: Handle<WorldAsset>,
    /// What it can be shown as, the most detailed first; empty before its levels are baked.
    pub(crate) levels: Vec<Level>,
}

/// A level of detail of a model, or the model itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Level {
    /// 0 is the source, `k` is LOD k.
    pub(crate) number: u32,
    pub(crate) triangles: u32,
}

/// The models of the asset folder, in the order of their names.
#[derive(Resource)]
pub(crate) struct Collection {
    pub(crate) models: Vec<Model>,
}

/// A model's instance: the index of its [`Model`].
#[derive(Component, Clone, Copy)]
pub(crate) struct Exhibit(pub(crate) usize);

/// The level that a gallery's exhibit shows at any distance.
#[derive(Component, Clone, Copy)]
pub(crate) struct Pinned(pub(crate) u32);

/// The plinth that an exhibit, its child, stands on.
#[derive(Component)]
pub(crate) struct Plinth;

/// Meshes and materials that all plinths share.
#[derive(Resource)]
struct PlinthLook {
    mesh: Handle<Mesh>,
    material: Handle<StandardMaterial>,
}

pub(crate) fn plugin(app: &mut App) {
    app.add_systems(PreStartup, find_models);
    app.add_systems(Startup, (place_sources, place_avenues));
    app.add_systems(Update, (note_levels, complete_rows).chain());
}

fn find_models(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let models = model_files(Path::new("assets")).into_iter().map(|file| Model {
        name: file.rsplit_once('.').map_or(file.as_str(), |(stem, _)| stem).to_owned(),
        gltf: server.load(file.clone()),
        scene: server.load(GltfAssetLabel::Scene(0).from_asset(file)),
        levels: Vec::new(),
    });
    commands.insert_resource(Collection { models: models.collect() });
    commands.insert_resource(PlinthLook {
        mesh: meshes.add(Cylinder::new(layout::PLINTH_RADIUS, layout::PLINTH_HEIGHT).mesh().resolution(48)),
        material: materials.add(StandardMaterial {
            base_color: Color::srgb(0.86, 0.86, 0.85),
            perceptual_roughness: 0.8,
            ..default()
        }),
    });
}

/// The names of the models directly in `folder`.
fn model_files(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| name.ends_with(".glb") || name.ends_with(".gltf"))
        .collect();
    files.sort();
    files
}

fn place_sources(mut commands: Commands, collection: Res<Collection>, look: Res<PlinthLook>) {
    for (index, model) in collection.models.iter().enumerate() {
        place(&mut commands, &look, layout::slot(index, 0, 1), (model.exhibit(index, Some(0)), Pinned(0)));
    }
}

fn place_avenues(mut commands: Commands, collection: Res<Collection>, look: Res<PlinthLook>) {
    for (index, model) in collection.models.iter().enumerate() {
        for position in 0..AVENUE {
            place(&mut commands, &look, layout::avenue(index, position), model.exhibit(index, None));
        }
    }
}

/// Puts a plinth with an exhibit on it at `position`, on the floor.
fn place(commands: &mut Commands, look: &PlinthLook, position: Vec3, exhibit: impl Bundle) {
    commands.spawn((
        Plinth,
        Mesh3d(look.mesh.clone()),
        MeshMaterial3d(look.material.clone()),
        Transform::from_translation(position + Vec3::Y * (layout::PLINTH_HEIGHT / 2.0)),
        children![exhibit],
    ));
}

impl Model {
    /// An instance that shows level `force`, or what the distance asks for; hidden until its size is known.
    fn exhibit(&self, index: usize, force: Option<u32>) -> impl Bundle + use<> {
        let lods = SimpliguardLods { force, ..default() };
        (Exhibit(index), WorldAssetRoot(self.scene.clone()), lods, Visibility::Hidden)
    }
}

/// Takes over the levels that the gallery's instances of the source have: those of the scene, or those of its objects.
#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn note_levels(
    mut collection: ResMut<Collection>,
    sources: Query<(Entity, &Exhibit, &Pinned)>,
    groups: Query<&LodGroup>,
    changed: Query<(), Changed<LodGroup>>,
    mut removed: RemovedComponents<LodGroup>,
    children: Query<&Children>,
) {
    if changed.is_empty() && removed.read().count() == 0 {
        return;
    }
    for (entity, exhibit, _) in sources.iter().filter(|(.., pinned)| pinned.0 == 0) {
        let of_objects = |group: &&LodGroup| group.objects.is_empty();
        let found = children.iter_descendants(entity).filter_map(|child| groups.get(child).ok()).filter(of_objects);
        let levels = levels_of(&found.collect::<Vec<_>>());
        if collection.models[exhibit.0].levels != levels {
            collection.models[exhibit.0].levels = levels;
        }
    }
}

/// The levels of some groups together, the most detailed first. A group without a level shows the next more detailed one.
fn levels_of(groups: &[&LodGroup]) -> Vec<Level> {
    let all = || groups.iter().flat_map(|group| &group.levels).map(|level| level.level);
    let stand_ins: BTreeSet<u32> = all().filter(|number| *number > 0).collect();
    let numbers = all().find(|number| *number == 0).into_iter().chain(stand_ins.into_iter().rev());
    let triangles = |number: u32| {
        let shown = |group: &&LodGroup| {
            let level = group.levels.iter().rfind(|level| number > 0 && level.level >= number);
            level.or(group.levels.first()).map_or(0, |level| level.faces)
        };
        groups.iter().map(shown).sum()
    };
    numbers.map(|number| Level { number, triangles: triangles(number) }).collect()
}

/// Gives every level of every model a plinth in the model's row, and takes away those of levels that are gone.
fn complete_rows(
    mut commands: Commands,
    collection: Res<Collection>,
    look: Res<PlinthLook>,
    pinned: Query<(&Exhibit, &Pinned, &ChildOf)>,
    mut plinths: Query<&mut Transform, With<Plinth>>,
) {
    if !collection.is_changed() {
        return;
    }
    for (index, model) in collection.models.iter().enumerate() {
        let row = model.row();
        for (_, level, plinth) in pinned.iter().filter(|(exhibit, ..)| exhibit.0 == index) {
            let Some(column) = row.iter().position(|number| *number == level.0) else {
                commands.entity(plinth.parent()).despawn();
                continue;
            };
            if let Ok(mut transform) = plinths.get_mut(plinth.parent()) {
                let place = layout::slot(index, column, row.len());
                transform.translation = place + Vec3::Y * (layout::PLINTH_HEIGHT / 2.0);
            }
        }
        for (column, number) in row.iter().enumerate() {
            if !pinned.iter().any(|(exhibit, level, _)| exhibit.0 == index && level.0 == *number) {
                let position = layout::slot(index, column, row.len());
                place(&mut commands, &look, position, (model.exhibit(index, Some(*number)), Pinned(*number)));
            }
        }
    }
}

impl Model {
    /// The levels of the model's row, the most detailed first: the source and its stand-ins.
    fn row(&self) -> Vec<u32> {
        std::iter::once(0).chain(self.levels.iter().map(|level| level.number).filter(|number| *number != 0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use bevy_simpliguard::lod::LodLevel;

    use super::*;

    fn group(levels: &[(u32, u32)]) -> LodGroup {
        let level = |&(level, faces): &(u32, u32)| LodLevel {
            level,
            budget: faces,
            faces,
            error: 0.0,
            primitives: Vec::new(),
            textures: Vec::new(),
        };
        let levels = levels.iter().map(level).collect();
        LodGroup { object: String::new(), center: Vec3::ZERO, radius: 1.0, levels, objects: Vec::new() }
    }

    #[test]
    fn levels_of_objects_are_added_up() {
        let (house, chair) = (group(&[(0, 900), (2, 200), (1, 100)]), group(&[(0, 50), (1, 20)]));
        let levels: Vec<_> = levels_of(&[&house, &chair]).iter().map(|level| (level.number, level.triangles)).collect();
        assert_eq!(levels, [(0, 950), (2, 250), (1, 120)]);
        assert!(levels_of(&[]).is_empty());
    }
}
