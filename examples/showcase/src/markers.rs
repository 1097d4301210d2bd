//! A coloured ring around every plinth says which level stands on it.

use bevy::light::NotShadowCaster;
use bevy::prelude::*;
use bevy_simpliguard::SimpliguardLods;
use bevy_simpliguard::overlay::{LEVELS, level_color};

use crate::exhibits::{Exhibit, Plinth};
use crate::layout::{PLINTH_HEIGHT, PLINTH_RADIUS};

/// The ring of a plinth, its parent.
#[derive(Component)]
struct Ring;

/// What rings are made of.
#[derive(Resource)]
struct RingLook {
    mesh: Handle<Mesh>,
    materials: Vec<Handle<StandardMaterial>>,
}

pub(crate) fn plugin(app: &mut App) {
    app.add_systems(PreStartup, prepare).add_systems(Update, (surround, paint).chain());
}

fn prepare(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
    let material = |color: Color| StandardMaterial {
        base_color: color,
        emissive: color.to_linear() * 0.25,
        perceptual_roughness: 0.6,
        ..default()
    };
    commands.insert_resource(RingLook {
        mesh: meshes.add(
            Torus::new(PLINTH_RADIUS - 0.02, PLINTH_RADIUS + 0.06).mesh().minor_resolution(8).major_resolution(48),
        ),
        materials: (0..=LEVELS).map(|level| materials.add(material(level_color(level)))).collect(),
    });
}

fn surround(mut commands: Commands, plinths: Query<Entity, Added<Plinth>>, look: Res<RingLook>) {
    for plinth in &plinths {
        commands.entity(plinth).with_child((
            Ring,
            Mesh3d(look.mesh.clone()),
            MeshMaterial3d(look.materials[0].clone()),
            Transform::from_xyz(0.0, PLINTH_HEIGHT / 2.0 - 0.02, 0.0),
            NotShadowCaster,
        ));
    }
}

fn paint(
    look: Res<RingLook>,
    exhibits: Query<(&SimpliguardLods, &ChildOf), (With<Exhibit>, Changed<SimpliguardLods>)>,
    plinths: Query<&Children, With<Plinth>>,
    mut rings: Query<&mut MeshMaterial3d<StandardMaterial>, With<Ring>>,
) {
    for (lods, plinth) in &exhibits {
        let material = &look.materials[lods.force.unwrap_or(lods.current).min(LEVELS) as usize];
        for child in plinths.get(plinth.parent()).into_iter().flatten() {
            if let Ok(mut shown) = rings.get_mut(*child)
                && shown.0 != *material
            {
                shown.0 = material.clone();
            }
        }
    }
}
