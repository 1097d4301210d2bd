//! The levels that an object of a scene comes with: how far each is from the object.

use std::sync::Arc;

use super::context::Context;
use crate::data::{Model, TriMesh, bounds};
use crate::geometry::Bvh;
use crate::gltf::{ImportLimits, import_in};
use crate::render::SurfaceSampler;
use crate::simplify::{DeviationMetric, OpaqueSurface};
use crate::{Error, NoResources, Source};

/// Largest distance between the bounding boxes of an object and of a level of it, as a fraction of the diagonal.
const MISPLACED: f32 = 0.1;

/// Measures levels against their object. All are binary glTF. The error of a level is the distance that 95 % of both surfaces
/// stay within, as a fraction of the diagonal of the object's bounding box. `None` for a level that cannot be read, or that
/// has another place or size than the object.
///
/// # Errors
/// If the bake is cancelled.
pub(super) fn errors(
    name: &str,
    object: &[u8],
    levels: &[Vec<u8>],
    context: &Context<'_>,
) -> Result<Vec<Option<f32>>, Error> {
    let mut limits = ImportLimits::default();
    limits.memory = context.memory.unwrap_or(limits.memory);
    let read = |bytes: &[u8]| {
        let source = Source { name, bytes, resources: &NoResources };
        match import_in(&source, &limits, &context.cancellation) {
            Ok(model) => Ok(Some(model)),
            Err(error @ Error::Cancelled { .. }) => Err(error),
            Err(_) => Ok(None),
        }
    };
    // What is wrong with the object itself, its bake will say.
    let Some(object) = read(object)? else { return Ok(vec![None; levels.len()]) };
    let bvh = Arc::new(Bvh::new(&object.surface.positions, &object.surface.triangles));
    let opaque = OpaqueSurface::of(&SurfaceSampler::new(&object), &bvh);
    let metric = DeviationMetric::new(&opaque, &context.cancellation);
    let error = |level: &Vec<u8>| {
        let Some(model) = read(level)? else { return Ok(None) };
        let Model { surface, .. } = model;
        let level = TriMesh { positions: surface.positions, triangles: surface.triangles };
        let is_placed = !level.triangles.is_empty() && distance(&level, &opaque.mesh) <= MISPLACED * metric.diagonal();
        Ok(is_placed.then(|| metric.measure(&level).percentile_95))
    };
    let errors = levels.iter().map(error).collect::<Result<_, _>>()?;
    context.cancellation.check(name)?;
    Ok(errors)
}

/// Largest difference between the corners of two bounding boxes.
fn distance(a: &TriMesh, b: &TriMesh) -> f32 {
    let [(a_low, a_high), (b_low, b_high)] = [a, b].map(|mesh| bounds(&mesh.positions));
    (a_low - b_low).abs().max_element().max((a_high - b_high).abs().max_element())
}
