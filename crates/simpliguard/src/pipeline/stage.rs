//! The stages in the order in which they run.

use serde::Serialize;

use crate::StageId;

/// A stage of the pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stage {
    /// Its name.
    pub id: StageId,
    /// Part of the keys of everything that the stage stores. Raise it when the stage stores something else for equal inputs
    /// and parameters; raise [`crate::PIPELINE_VERSION`] when the bytes of a result change.
    pub version: u32,
    /// One line for the overlay, the report and the documentation.
    pub purpose: &'static str,
    /// Typical fraction of the time of a bake, in percent. Progress is measured by it.
    pub weight: u32,
    /// The stage runs once for each level; the others run once for the model.
    pub per_level: bool,
}

/// The stages in their order. `reconstruct` runs within `simplify`, once for each candidate that is a reconstruction.
pub const STAGES: [Stage; 10] = [
    once(StageId::Import, 3, 2, "glTF to one surface in world space"),
    once(StageId::Views, 1, 8, "views of the source, at rest and in its poses"),
    once(StageId::Reconstruct, 2, 4, "watertight manifold around the source"),
    once(StageId::Simplify, 13, 16, "candidates collapsed to the budgets, the best selected"),
    per_level(StageId::Unwrap, 1, 3, "charts, least squares conformal maps, packing"),
    per_level(StageId::Skinning, 1, 3, "influences from the source's skeleton"),
    per_level(StageId::Texture, 1, 4, "initial texture baked from the source"),
    per_level(StageId::Refine, 3, 48, "differentiable rendering of vertices and texture"),
    per_level(StageId::Maps, 4, 10, "texture set on the final vertices"),
    once(StageId::Export, 2, 2, "source and levels as one binary glTF"),
];

const fn once(id: StageId, version: u32, weight: u32, purpose: &'static str) -> Stage {
    Stage { id, version, purpose, weight, per_level: false }
}

const fn per_level(id: StageId, version: u32, weight: u32, purpose: &'static str) -> Stage {
    Stage { per_level: true, ..once(id, version, weight, purpose) }
}

impl Stage {
    /// The row of a stage.
    pub(crate) fn of(id: StageId) -> &'static Self {
        &STAGES[id as usize]
    }

    /// Fraction of a bake that is done when a stage begins: the weights of the stages before it.
    pub(crate) fn begins_at(id: StageId) -> f32 {
        let sum = |stages: &[Self]| stages.iter().map(|stage| stage.weight).sum::<u32>() as f32;
        sum(&STAGES[..id as usize]) / sum(&STAGES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_the_names_and_its_weights_are_percents() {
        for (i, stage) in STAGES.iter().enumerate() {
            assert_eq!((stage.id as usize, Stage::of(stage.id)), (i, stage));
        }
        assert_eq!(STAGES.iter().map(|stage| stage.weight).sum::<u32>(), 100);
        assert_eq!((Stage::begins_at(StageId::Import), Stage::begins_at(StageId::Views)), (0.0, 0.02));
    }
}
