//! The visible size of the triangles of a source, through its cut-outs and clear surfaces too.

use glam::Vec3;

use super::inputs::ReductionInputs;
use crate::data::{AlphaMode, TriMesh};
use crate::geometry::BoundingSphere;
use crate::simplify::enclosed::keep_enclosed;
use crate::simplify::visibility::{self, DIRECTIONS};

/// Pixels of each triangle, summed over views.
pub(super) struct Pixels {
    /// Those that show it.
    pub(super) covered: Vec<u32>,
    /// The same, where those on outlines count many times.
    pub(super) weighted: Vec<u32>,
}

/// How much of what lies behind it a triangle hides.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Hiding {
    All,
    CutOut,
    Nothing,
}

impl Pixels {
    /// Counts pixels in the rest pose and, from half as many directions, in others.
    pub(super) fn count(inputs: &ReductionInputs<'_>, poses: &[Vec<Vec3>]) -> Self {
        let faces = inputs.model.surface.triangles.len();
        let mut out = Self { covered: vec![0; faces], weighted: vec![0; faces] };
        out.add(inputs, &inputs.model.surface.positions, DIRECTIONS);
        let directions = (DIRECTIONS / 2).div_ceil(poses.len().max(1));
        poses.iter().for_each(|positions| out.add(inputs, positions, directions));
        out
    }

    /// Adds views of one pose. Each triangle is seen as well as it is without those that hide less than it does: what stands
    /// behind glass, or among leaves, shows.
    fn add(&mut self, inputs: &ReductionInputs<'_>, positions: &[Vec3], directions: usize) {
        let (surface, sphere) = (&inputs.model.surface, BoundingSphere::around(positions));
        let hiding: Vec<Hiding> = (0..surface.triangles.len() as u32).map(|t| inputs.hiding(t)).collect();
        let mut best = vec![[0; 2]; surface.triangles.len()];
        for least in [Hiding::All, Hiding::CutOut, Hiding::Nothing] {
            if !hiding.contains(&least) {
                continue;
            }
            let shown: Vec<usize> = (0..hiding.len()).filter(|&t| hiding[t] <= least).collect();
            let triangles = shown.iter().map(|&t| surface.triangles[t]).collect();
            let mesh = TriMesh { positions: positions.to_vec(), triangles };
            let double_sided = |i: usize| inputs.model.material_of(shown[i] as u32).double_sided;
            let pixels = visibility::visible_pixels(&mesh, &sphere, directions, &double_sided, inputs.cancellation);
            for (i, weighted) in pixels.weighted().into_iter().enumerate() {
                let [most_covered, most_weighted] = &mut best[shown[i]];
                *most_covered = pixels.covered[i].max(*most_covered);
                *most_weighted = weighted.max(*most_weighted);
            }
        }
        for (t, [covered, weighted]) in best.into_iter().enumerate() {
            self.covered[t] += covered;
            self.weighted[t] += weighted;
        }
    }

    /// Triangles that nothing sees: no view shows them, and no ray from them escapes in the rest pose. Cut-outs and clear
    /// surfaces are never among them.
    pub(super) fn hidden(&self, inputs: &ReductionInputs<'_>) -> Vec<bool> {
        let surface = &inputs.model.surface;
        let opaque: Vec<u32> =
            (0..surface.triangles.len() as u32).filter(|&t| inputs.hiding(t) == Hiding::All).collect();
        let triangles = opaque.iter().map(|&t| surface.triangles[t as usize]).collect();
        let mesh = TriMesh { positions: surface.positions.clone(), triangles };
        let is_double_sided = |t: u32| inputs.model.material_of(t).double_sided;
        let two_sided = opaque.iter().all(|&t| is_double_sided(t));
        let unseen = |&t: &u32| self.covered[t as usize] == 0 && is_double_sided(t) == two_sided;
        let mut enclosed: Vec<bool> = opaque.iter().map(unseen).collect();
        let sphere = BoundingSphere::around(&surface.positions);
        keep_enclosed(&mut enclosed, &mesh, &sphere, two_sided, inputs.cancellation);
        let mut hidden = vec![false; surface.triangles.len()];
        opaque.iter().zip(enclosed).for_each(|(&t, enclosed)| hidden[t as usize] = enclosed);
        hidden
    }
}

impl ReductionInputs<'_> {
    fn hiding(&self, t: u32) -> Hiding {
        let material = self.model.material_of(t);
        match material.alpha_mode {
            AlphaMode::Blend => Hiding::Nothing,
            AlphaMode::Opaque if material.transmission.is_some() => Hiding::Nothing,
            AlphaMode::Mask { .. } => Hiding::CutOut,
            AlphaMode::Opaque => Hiding::All,
        }
    }
}
