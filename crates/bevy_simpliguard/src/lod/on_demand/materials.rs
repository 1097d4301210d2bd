//! Materials whose textures have changed. A renderer binds the textures of a material when the material is prepared, so it is
//! marked as changed. Its type is not known here: it is found by reflection.

use std::any::TypeId;

use bevy::asset::{ReflectAsset, ReflectHandle, UntypedAssetId};
use bevy::ecs::reflect::AppTypeRegistry;
use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use bevy::reflect::{ReflectRef, TypeRegistry};

/// The name of the component with the material of a mesh.
const COMPONENT: &str = "MeshMaterial3d";

/// Types of materials that could not be marked, so that each is reported once.
#[derive(Resource, Default)]
struct Unknown(HashSet<String>);

/// The material of an entity.
enum Material {
    Known(TypeId, UntypedAssetId),
    /// The path of a type that is not registered.
    Unknown(String),
}

/// Marks the materials of these entities as changed.
pub(super) fn refresh(world: &mut World, entities: impl IntoIterator<Item = Entity>) {
    let Some(registry) = world.get_resource::<AppTypeRegistry>().cloned() else { return };
    let registry = registry.read();
    let mut done: HashSet<UntypedAssetId> = HashSet::default();
    for entity in entities {
        match material_of(world, &registry, entity) {
            Some(Material::Known(kind, id)) => {
                if let Some(assets) = registry.get_type_data::<ReflectAsset>(kind).filter(|_| done.insert(id)) {
                    assets.get_mut(world, id);
                }
            }
            Some(Material::Unknown(name)) => report(world, name),
            None => {}
        }
    }
}

fn report(world: &mut World, name: String) {
    let mut reported = world.get_resource_or_init::<Unknown>();
    if !reported.0.contains(&name) {
        warn!("a source shows no textures: register its material with `register_asset_reflect` ({name})");
        reported.0.insert(name);
    }
}

fn material_of(world: &World, registry: &TypeRegistry, entity: Entity) -> Option<Material> {
    let entity = world.get_entity(entity).ok()?;
    let types = entity.archetype().components().iter();
    let types = types.filter_map(|component| world.components().get_info(*component)?.type_id());
    let is_material = |kind: &TypeId| {
        registry.get_type_info(*kind).is_some_and(|info| info.type_path_table().ident() == Some(COMPONENT))
    };
    let component = types.filter(is_material).find_map(|kind| registry.get_type_data::<ReflectComponent>(kind))?;
    let ReflectRef::TupleStruct(component) = component.reflect(entity)?.reflect_ref() else { return None };
    let handle = component.field(0)?.try_as_reflect()?;
    let Some(kind) = registry.get_type_data::<ReflectHandle>(handle.as_any().type_id()) else {
        return Some(Material::Unknown(handle.reflect_type_path().to_owned()));
    };
    let id = kind.downcast_handle_untyped(handle.as_any())?.id();
    Some(Material::Known(kind.asset_type_id(), id))
}
