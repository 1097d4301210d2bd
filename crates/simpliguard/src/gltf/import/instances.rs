//! Instances of a node: `EXT_mesh_gpu_instancing`.

use glam::{Mat4, Quat, Vec3};

use super::accessor::Reader;
use super::nodes::trs;
use super::schema::Node;
use crate::Error;

/// The transforms of a node's instances, in the node's space; one identity without the extension.
pub(super) fn instances(reader: Reader<'_>, node: &Node<'_>) -> Result<Vec<Mat4>, Error> {
    let Some(instancing) = &node.extensions.instancing else { return Ok(vec![Mat4::IDENTITY]) };
    let count = instance_count(reader, node)? as u32;
    let attribute = |name: &str| instancing.attributes.get(name).copied();
    let vectors = |name: &str, missing: Vec3| -> Result<Vec<Vec3>, Error> {
        Ok(match attribute(name) {
            Some(accessor) => reader.floats(accessor, 0..count)?.into_iter().map(Vec3::from).collect(),
            None => vec![missing; count as usize],
        })
    };
    let rotations = match attribute("ROTATION") {
        Some(accessor) => reader.floats(accessor, 0..count)?.into_iter().map(Quat::from_array).collect(),
        None => vec![Quat::IDENTITY; count as usize],
    };
    let (translations, scales) = (vectors("TRANSLATION", Vec3::ZERO)?, vectors("SCALE", Vec3::ONE)?);
    Ok(translations.iter().zip(rotations).zip(scales).map(|((&t, r), s)| trs(t, r, s)).collect())
}

/// Number of a node's instances; one without the extension.
pub(super) fn instance_count(reader: Reader<'_>, node: &Node<'_>) -> Result<usize, Error> {
    let Some(instancing) = &node.extensions.instancing else { return Ok(1) };
    let known = ["TRANSLATION", "ROTATION", "SCALE"].map(|name| instancing.attributes.get(name));
    known.into_iter().flatten().next().map_or(Ok(1), |&accessor| reader.count(accessor))
}
