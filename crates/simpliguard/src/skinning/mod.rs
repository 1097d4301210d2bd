//! Skin influences of a level, taken over from the source.
//!
//! Two ways. [`Transfer::ClosestSurface`], the default, follows "Robust Skin Weights Transfer via Weight Inpainting"
//! (Abdrashitov, Raichstat, Monsen and Hill, SIGGRAPH Asia 2023): a vertex takes the influences of the closest point
//! of the source if that is near and faces the same way; what is left is filled in smoothly over the level's own edges.
//! Where the paper minimises a mix of Dirichlet and Laplacian energy, this solves Laplace's equation with positive edge
//! weights, so that weights stay between those around them and sum to one. [`Transfer::NearestVertices`] is the
//! formula of SimpliGuard, section 3.5, normalised.
//!
//! Both work in the rest pose and keep the four largest influences. Parts of the source that are not connected are told
//! apart where they touch (`parts`); folds of one part that touch in the rest pose and face the same way are not.
//!
//! A few frames of the source's clips, chosen to stand for all of them ([`Poses`]), go with the rest pose through every
//! later decision: what can be seen, which edges collapse, which candidate wins, where vertices and texels end up.

mod bone_remap;
mod closest;
mod fit;
mod inpaint;
mod joint_planes;
mod morphs;
mod nearest;
mod source;

use glam::Vec3;

use crate::animation::{Poses, Weights};
use crate::data::{Influences, TriMesh, bounds};

pub use bone_remap::BoneRemap;
pub use joint_planes::{JointPlane, JointSplit, joint_planes, split_along};
pub use morphs::transfer_morphs;
pub use source::SkinSource;

/// Farthest point of the source that counts, as a fraction of the diagonal of its bounding box.
const MAX_DISTANCE: f32 = 0.05;
/// Largest angle between the normals there, in degrees.
const MAX_ANGLE: f32 = 90.0;

/// How influences are found.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Transfer {
    /// Those of the closest point of the source, where it is near and faces the same way; the rest from their
    /// neighbours.
    ClosestSurface {
        /// Farthest accepted point, as a fraction of the diagonal of the source's bounding box.
        max_distance: f32,
        /// Largest accepted angle between the normals, in degrees.
        max_angle: f32,
    },
    /// Those of the nearest source vertices, nearer ones weighing more.
    NearestVertices {
        /// How many; at least one.
        k: usize,
    },
}

impl Default for Transfer {
    /// Normals only tell the two sides of a sheet apart: a coarse level's own normals stray far from the source's, so
    /// that 30 degrees, as published, reject good matches at every crease and leave worse motion behind.
    fn default() -> Self {
        Self::ClosestSurface { max_distance: MAX_DISTANCE, max_angle: MAX_ANGLE }
    }
}

/// How many vertices came by their influences in which way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct TransferReport {
    /// Directly from the source.
    pub matched: usize,
    /// From their neighbours.
    pub inpainted: usize,
    /// From the closest point although it failed the tests, as no vertex they are connected with passed.
    pub forced: usize,
}

/// How a level is skinned.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SkinningParams {
    /// How influences are found.
    pub transfer: Transfer,
    /// Joints that move fewer faces of a level give way to the joint above; 0 keeps all.
    pub bone_faces: f32,
    /// Weights are fitted to the poses.
    pub fit_weights: bool,
}

/// Influences of each vertex of a level in the rest pose: transferred from the source, moved to the bones that are left,
/// and fitted to the poses. Empty for a model without bones.
pub fn skin(
    source: &SkinSource<'_>,
    poses: Option<&Poses<'_>>,
    mesh: &TriMesh,
    params: &SkinningParams,
) -> Vec<Influences> {
    let (mut influences, _) = transfer(source, mesh, &mesh.vertex_normals(), params.transfer);
    if let Some(remap) = BoneRemap::of(source.model, mesh.triangles.len(), params.bone_faces) {
        remap.fold(&mut influences);
    }
    match poses {
        Some(poses) if params.fit_weights => fit(source, poses, mesh, influences),
        _ => influences,
    }
}

/// Influences for each vertex of `mesh`, a level in the rest pose with unit vertex normals. Empty for a model without bones; otherwise every vertex has at least one influence.
pub fn transfer(
    skin_source: &SkinSource<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    method: Transfer,
) -> (Vec<Influences>, TransferReport) {
    let model = skin_source.model;
    if model.rig.is_none() || model.surface.influences.is_empty() {
        return (Vec::new(), TransferReport::default());
    }
    match method {
        Transfer::ClosestSurface { max_distance, max_angle } => {
            closest_surface(skin_source, mesh, normals, max_distance, max_angle)
        }
        Transfer::NearestVertices { k } => {
            let influences = nearest::transfer(&model.surface, &mesh.positions, k);
            (influences, TransferReport { matched: mesh.positions.len(), ..TransferReport::default() })
        }
    }
}

/// Weights of `mesh`, a level in the rest pose with these `influences`, fitted to the poses over its whole surface: points
/// between its vertices follow the source too. Bones stay, and nothing changes where the source is too far.
pub fn fit(
    skin_source: &SkinSource<'_>,
    poses: &Poses<'_>,
    mesh: &TriMesh,
    influences: Vec<Influences>,
) -> Vec<Influences> {
    if influences.is_empty() {
        return influences;
    }
    fit::fit(skin_source, poses, mesh, influences, limits(skin_source, MAX_DISTANCE, MAX_ANGLE))
}

fn limits(skin_source: &SkinSource<'_>, max_distance: f32, max_angle: f32) -> closest::MatchLimits {
    let (low, high) = bounds(&skin_source.model.surface.positions);
    closest::MatchLimits {
        distance: max_distance * low.distance(high),
        cosine: libm::cosf(max_angle.clamp(0.0, 180.0).to_radians()),
    }
}

fn closest_surface(
    skin_source: &SkinSource<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    max_distance: f32,
    max_angle: f32,
) -> (Vec<Influences>, TransferReport) {
    let samples = closest::sample(skin_source, mesh, normals, limits(skin_source, max_distance, max_angle));
    let matched: Vec<bool> = samples.iter().map(|s| s.is_match).collect();
    let forced = inpaint::unreachable(mesh, &matched);
    let known: Vec<bool> = matched.iter().zip(&forced).map(|(m, f)| m | f).collect();
    let mut weights: Vec<Weights> = samples.into_iter().map(|s| s.weights).collect();
    inpaint::fill(mesh, &known, &mut weights);
    let count = |flags: &[bool]| flags.iter().filter(|&&f| f).count();
    let report =
        TransferReport { matched: count(&matched), inpainted: known.len() - count(&known), forced: count(&forced) };
    (weights.iter().map(Weights::strongest).collect(), report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{AlphaMode, Document, Material, Model, Rig, Surface};
    use crate::geometry::Bvh;
    use proptest::prelude::*;

    /// A strip of quads along x, one unit each, from bone 0 at its start to bone 1 at its end.
    fn strip(quads: usize) -> Surface {
        let mut surface = Surface::default();
        for i in 0..=quads {
            let t = i as f32 / quads as f32;
            for y in [0.0, 1.0] {
                surface.positions.push(Vec3::new(i as f32, y, 0.0));
                surface.normals.push(Vec3::Z);
                let influences = if t <= 0.5 {
                    Influences { joints: [0, 1, 0, 0], weights: [1.0 - t, t, 0.0, 0.0] }
                } else {
                    Influences { joints: [1, 0, 0, 0], weights: [t, 1.0 - t, 0.0, 0.0] }
                };
                surface.influences.push(influences);
            }
        }
        for i in 0..quads as u32 {
            surface.triangles.extend([[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]);
        }
        surface.material = vec![0; surface.triangles.len()];
        surface
    }

    fn model(surface: Surface) -> Model {
        Model {
            name: "strip".into(),
            surface,
            materials: vec![Material::default()],
            textures: Vec::new(),
            rig: Some(Rig { bones: Vec::new(), source_skin: None, poses: Vec::new() }),
            document: Document::default(),
            notes: Vec::new(),
        }
    }

    fn run(model: &Model, mesh: &TriMesh, normals: &[Vec3], method: Transfer) -> (Vec<Influences>, TransferReport) {
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        transfer(&SkinSource::new(model, &bvh), mesh, normals, method)
    }

    fn points(positions: &[Vec3]) -> TriMesh {
        TriMesh { positions: positions.to_vec(), triangles: Vec::new() }
    }

    /// Weight of a bone.
    fn part(influences: &Influences, joint: u16) -> f32 {
        let slots = influences.joints.iter().zip(&influences.weights);
        slots.filter(|(j, _)| **j == joint).map(|(_, w)| w).sum()
    }

    #[test]
    fn influences_are_interpolated_within_a_face() {
        let model = model(strip(4));
        let level = points(&[Vec3::new(1.5, 0.5, 0.01), Vec3::new(0.0, 0.3, 0.0)]);
        let (influences, report) = run(&model, &level, &[Vec3::Z; 2], Transfer::default());
        assert!((part(&influences[0], 1) - 0.375).abs() < 1e-6);
        assert_eq!(influences[1], Influences::rigid(0));
        assert_eq!(report, TransferReport { matched: 2, inpainted: 0, forced: 0 });
    }

    #[test]
    fn a_vertex_that_faces_away_is_filled_from_its_neighbours() {
        let model = model(strip(4));
        // Ends at a quarter and three quarters; the middle faces away and is one from either.
        let level = TriMesh {
            positions: vec![Vec3::new(1.0, 0.5, 0.0), Vec3::new(2.0, 0.5, 0.0), Vec3::new(3.0, 0.5, 0.0)],
            triangles: vec![[0, 1, 2]],
        };
        let normals = [Vec3::Z, -Vec3::Z, Vec3::Z];
        let (influences, report) = run(&model, &level, &normals, Transfer::default());
        assert!((part(&influences[1], 0) - 0.5).abs() < 1e-6, "{influences:?}");
        assert_eq!(report, TransferReport { matched: 2, inpainted: 1, forced: 0 });
    }

    #[test]
    fn nearer_neighbours_weigh_more() {
        let model = model(strip(4));
        let level = TriMesh {
            positions: vec![Vec3::new(0.0, 0.5, 0.0), Vec3::new(1.0, 0.5, 0.0), Vec3::new(4.0, 0.5, 0.0)],
            triangles: vec![[0, 1, 2]],
        };
        let normals = [Vec3::Z, -Vec3::Z, Vec3::Z];
        let (influences, _) = run(&model, &level, &normals, Transfer::default());
        // Edge weights are one over the length: 1 and 1/3 give a quarter.
        assert!((part(&influences[1], 1) - 0.25).abs() < 1e-6, "{influences:?}");
    }

    #[test]
    fn double_sided_faces_match_from_behind() {
        let mut model = model(strip(4));
        model.materials[0].double_sided = true;
        model.materials[0].alpha_mode = AlphaMode::Opaque;
        let (_, report) = run(&model, &points(&[Vec3::new(2.0, 0.5, -0.01)]), &[-Vec3::Z], Transfer::default());
        assert_eq!(report.matched, 1);
    }

    #[test]
    fn a_piece_far_from_everything_takes_the_closest_point() {
        let model = model(strip(4));
        let level = TriMesh {
            positions: vec![Vec3::new(50.0, 0.0, 0.0), Vec3::new(51.0, 0.0, 0.0), Vec3::new(50.0, 1.0, 0.0)],
            triangles: vec![[0, 1, 2]],
        };
        let (influences, report) = run(&model, &level, &[Vec3::Z; 3], Transfer::default());
        assert_eq!(influences, [Influences::rigid(1); 3]);
        assert_eq!(report, TransferReport { matched: 0, inpainted: 0, forced: 3 });
    }

    #[test]
    fn nearest_vertices_weigh_by_the_papers_formula() {
        let mut surface = strip(1);
        surface.positions = vec![Vec3::ZERO, Vec3::Y * 9.0, Vec3::X * 3.0, Vec3::X * 9.0 + Vec3::Y * 9.0];
        let level = points(&[Vec3::X]);
        // Distances 1 and 2: parts 1 - 1/3 and 1 - 2/3 of the bones at the two ends.
        let (influences, _) = run(&model(surface), &level, &[Vec3::Z], Transfer::NearestVertices { k: 2 });
        assert_eq!(influences[0].joints, [0, 1, 0, 0]);
        assert!((influences[0].weights[0] - 2.0 / 3.0).abs() < 1e-6, "{influences:?}");
    }

    #[test]
    fn one_nearest_vertex_gives_its_own_influences() {
        let model = model(strip(4));
        let (influences, _) =
            run(&model, &points(&[Vec3::new(1.1, 0.0, 0.0)]), &[Vec3::Z], Transfer::NearestVertices { k: 1 });
        assert_eq!(influences[0].weights, [0.75, 0.25, 0.0, 0.0]);
    }

    #[test]
    fn a_static_model_has_no_influences() {
        let model = Model { rig: None, ..model(strip(1)) };
        assert!(run(&model, &points(&[Vec3::X]), &[Vec3::Z], Transfer::default()).0.is_empty());
    }

    proptest! {
        #[test]
        fn weights_fall_and_sum_to_one_whatever_the_level(
            corners in prop::collection::vec((-2.0f32..6.0, -1.0f32..2.0, -0.5f32..0.5, any::<bool>()), 3..30),
            k in 1usize..9,
            nearest in any::<bool>(),
        ) {
            let positions: Vec<Vec3> = corners.iter().map(|c| Vec3::new(c.0, c.1, c.2)).collect();
            let normals: Vec<Vec3> = corners.iter().map(|c| if c.3 { Vec3::Z } else { -Vec3::Z }).collect();
            let triangles = (0..positions.len() as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
            let level = TriMesh { positions, triangles };
            let method = if nearest { Transfer::NearestVertices { k } } else { Transfer::default() };
            let (influences, report) = run(&model(strip(4)), &level, &normals, method);
            prop_assert_eq!(report.matched + report.inpainted + report.forced, level.positions.len());
            for i in &influences {
                prop_assert!((i.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                prop_assert!(i.weights.windows(2).all(|w| w[0] >= w[1]) && i.weights[3] >= 0.0);
                prop_assert!(i.joints.iter().zip(&i.weights).all(|(&j, &w)| w > 0.0 || j == 0));
            }
        }
    }
}
