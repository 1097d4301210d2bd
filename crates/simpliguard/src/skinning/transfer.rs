//! Transfer of influences from the source to the vertices of a level.

use glam::Vec3;

use super::closest_surface::{MAX_ANGLE, MAX_DISTANCE, MatchLimits, closest_matches};
use super::skin_source::SkinSource;
use super::{inpaint, nearest_vertices};
use crate::animation::Weights;
use crate::data::{Influences, TriMesh};

/// Methods of transfer.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Transfer {
    /// The influences of the closest point of the source, if it is near and faces the same way; else interpolated from
    /// the neighbours.
    ClosestSurface {
        /// Largest accepted distance, as a fraction of the diagonal of the source's bounding box.
        max_distance: f32,
        /// Largest accepted angle between the normals, in degrees.
        max_angle: f32,
    },
    /// The influences of the nearest vertices of the source; the nearer ones weigh more.
    NearestVertices {
        /// Number of vertices, at least one.
        k: usize,
    },
}

impl Default for Transfer {
    /// The closest surface, with an angle that only distinguishes the two sides of a sheet. The normals of a coarse
    /// level differ far from those of the source: the published 30 degrees reject good matches at every crease, and
    /// motion gets worse.
    fn default() -> Self {
        Self::ClosestSurface { max_distance: MAX_DISTANCE, max_angle: MAX_ANGLE }
    }
}

/// Numbers of vertices by the origin of their influences.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct TransferReport {
    /// Directly from the source.
    pub matched: usize,
    /// From their neighbours.
    pub inpainted: usize,
    /// From the closest point, although it is not within the limits: no connected vertex has a match.
    pub forced: usize,
}

/// Influences for each vertex of `mesh`, a level in the rest pose with unit vertex normals. Empty for a model without
/// bones; otherwise every vertex has at least one influence.
pub fn transfer(
    source: &SkinSource<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    method: Transfer,
) -> (Vec<Influences>, TransferReport) {
    let model = source.model;
    if model.rig.is_none() || model.surface.influences.is_empty() {
        return (Vec::new(), TransferReport::default());
    }
    match method {
        Transfer::ClosestSurface { max_distance, max_angle } => {
            closest_surface(source, mesh, normals, MatchLimits::new(model, max_distance, max_angle))
        }
        Transfer::NearestVertices { k } => {
            let influences = nearest_vertices::transfer(&model.surface, &mesh.positions, k);
            (influences, TransferReport { matched: mesh.positions.len(), ..TransferReport::default() })
        }
    }
}

fn closest_surface(
    source: &SkinSource<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    limits: MatchLimits,
) -> (Vec<Influences>, TransferReport) {
    let closest = closest_matches(source, mesh, normals, limits);
    let matched: Vec<bool> = closest.iter().map(|c| c.is_match).collect();
    let forced = inpaint::unreachable(mesh, &matched);
    let known: Vec<bool> = matched.iter().zip(&forced).map(|(m, f)| m | f).collect();
    let mut weights: Vec<Weights> = closest.into_iter().map(|c| c.weights).collect();
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

    /// The weight on a bone.
    fn weight_on(influences: &Influences, joint: u16) -> f32 {
        let slots = influences.joints.iter().zip(&influences.weights);
        slots.filter(|(j, _)| **j == joint).map(|(_, w)| w).sum()
    }

    #[test]
    fn influences_are_interpolated_within_a_face() {
        let model = model(strip(4));
        let level = points(&[Vec3::new(1.5, 0.5, 0.01), Vec3::new(0.0, 0.3, 0.0)]);
        let (influences, report) = run(&model, &level, &[Vec3::Z; 2], Transfer::default());
        assert!((weight_on(&influences[0], 1) - 0.375).abs() < 1e-6);
        assert_eq!(influences[1], Influences::rigid(0));
        assert_eq!(report, TransferReport { matched: 2, inpainted: 0, forced: 0 });
    }

    #[test]
    fn a_vertex_that_faces_away_is_filled_from_its_neighbours() {
        let model = model(strip(4));
        // The ends lie at a quarter and at three quarters; the middle faces away, at a distance of one from either.
        let level = TriMesh {
            positions: vec![Vec3::new(1.0, 0.5, 0.0), Vec3::new(2.0, 0.5, 0.0), Vec3::new(3.0, 0.5, 0.0)],
            triangles: vec![[0, 1, 2]],
        };
        let normals = [Vec3::Z, -Vec3::Z, Vec3::Z];
        let (influences, report) = run(&model, &level, &normals, Transfer::default());
        assert!((weight_on(&influences[1], 0) - 0.5).abs() < 1e-6, "{influences:?}");
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
        // Edge weights are the inverse lengths: 1 and 1/3 give a quarter.
        assert!((weight_on(&influences[1], 1) - 0.25).abs() < 1e-6, "{influences:?}");
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
        // Distances 1 and 2: the bones at the two ends get 1 - 1/3 and 1 - 2/3.
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
