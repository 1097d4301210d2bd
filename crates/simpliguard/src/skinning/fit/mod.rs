//! Fits the joint weights of a level to the motion of the source over whole faces.
//!
//! The weights of the closest points move each vertex as the source moves. Between vertices the faces deviate if the
//! source's weights are not linear there. The fit minimises `sum_k sum_s a_s |x_s^k - M_s^k x_s|^2` over points `x_s`
//! of the level that stand for areas `a_s`: `x_s^k` is the position of the point in pose `k` by the corners of its
//! face, `M_s^k` the motion of the source's closest point. The error is quadratic in the weights. If the rest pose is
//! not the bind pose, it is linearised by [`Poses::by_weights`]. Accelerated projected gradient steps (FISTA; Beck and
//! Teboulle 2009) keep the weights of each vertex on the simplex of its bones.

mod problem;
mod samples;

use self::problem::Problem;
use self::samples::{PoseError, Samples};
use super::closest_surface::MatchLimits;
use super::skin_source::SkinSource;
use crate::animation::Poses;
use crate::data::{Influences, TriMesh};

/// The influences of `mesh`, a level in the rest pose, fitted to the poses over its whole surface. The bones of each
/// vertex stay. Points for which the source has no match within the limits do not count. Empty if `influences` is
/// empty.
pub(super) fn fit(
    source: &SkinSource<'_>,
    poses: &Poses<'_>,
    mesh: &TriMesh,
    influences: Vec<Influences>,
    limits: MatchLimits,
) -> Vec<Influences> {
    if influences.is_empty() {
        return influences;
    }
    let samples = Samples::new(source, mesh, limits);
    let start = samples.errors(poses, mesh, &influences);
    let problem = Problem::new(poses, mesh, &influences, &samples, &start);
    let fitted = problem.solve(&influences);
    let total = |errors: &[PoseError]| errors.iter().map(|pose| pose.total).sum::<f64>();
    // If the rest pose is not the bind pose, the derivatives hold only near the start: the error may rise.
    if total(&samples.errors(poses, mesh, &fitted)) < total(&start) { fitted } else { influences }
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, Vec3};

    use super::samples::tests::coarse;
    use super::*;
    use crate::Cancellation;
    use crate::animation::ordered;
    use crate::data::{Bone, Model, Pose, Rig, Surface};
    use crate::geometry::Bvh;

    /// A strip along x from 0 to 4 in 32 columns. The weight of the second bone is the square of the fraction of the
    /// length; the pose lifts that bone by one.
    fn curved() -> Model {
        let bone = |node| Bone { node, inverse_bind: Mat4::IDENTITY, rest_world: Mat4::IDENTITY };
        let pose = Pose { frame: Some((0, 0.0)), world: vec![Mat4::IDENTITY, Mat4::from_translation(Vec3::Z)] };
        let rig = Some(Rig { bones: vec![bone(0), bone(1)], source_skin: Some(0), poses: vec![pose] });
        let mut surface = Surface::default();
        for i in 0..=32 {
            let t = i as f32 / 32.0;
            for y in [0.0, 1.0] {
                surface.positions.push(Vec3::new(4.0 * t, y, 0.0));
                surface.normals.push(Vec3::Z);
                surface
                    .influences
                    .push(ordered(&Influences { joints: [0, 1, 0, 0], weights: [1.0 - t * t, t * t, 0.0, 0.0] }));
            }
        }
        for i in 0..32 {
            surface.triangles.extend([[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]);
        }
        surface.material = vec![0; surface.triangles.len()];
        Model { surface, rig, ..Model::empty("curve") }
    }

    const LIMITS: MatchLimits = MatchLimits { distance: 1.0, cosine: 0.0 };

    /// The weight on the second bone.
    fn second(influences: &Influences) -> f32 {
        let slots = influences.joints.iter().zip(influences.weights);
        slots.filter(|(joint, _)| **joint == 1).map(|(_, weight)| weight).sum()
    }

    #[test]
    fn a_curve_is_fitted_between_its_points() {
        let model = curved();
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        let source = SkinSource::new(&model, &bvh);
        let poses = Poses::of(&model, 1, 1, &Cancellation::default()).expect("it moves");
        // A chord between two points of a parabola lies above it. The fitted chord lies below it in the middle.
        let at = |t: f32| Influences { joints: [0, 1, 0, 0], weights: [1.0 - t, t, 0.0, 0.0] };
        let given: Vec<Influences> = [1e-6, 0.25, 1.0 - 1e-6].into_iter().flat_map(|t| [at(t), at(t)]).collect();
        let samples = Samples::new(&source, &coarse(), LIMITS);
        let error = |i: &[Influences]| samples.errors(&poses, &coarse(), i)[0].total;
        let fitted = fit(&source, &poses, &coarse(), given.clone(), LIMITS);
        assert!(second(&fitted[2]) < 0.23 && second(&fitted[3]) < 0.23, "{fitted:?}");
        assert!(error(&fitted) < 0.6 * error(&given), "{} {}", error(&fitted), error(&given));
        assert!(fitted.iter().all(|i| (i.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn what_follows_the_source_stays() {
        let mut model = curved();
        let positions = model.surface.positions.clone();
        for (influences, p) in model.surface.influences.iter_mut().zip(&positions) {
            let t = p.x / 4.0;
            *influences = ordered(&Influences { joints: [0, 1, 0, 0], weights: [1.0 - t, t, 0.0, 0.0] });
        }
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        let source = SkinSource::new(&model, &bvh);
        let poses = Poses::of(&model, 1, 1, &Cancellation::default()).expect("it moves");
        let at =
            |p: &Vec3| ordered(&Influences { joints: [0, 1, 0, 0], weights: [1.0 - p.x / 4.0, p.x / 4.0, 0.0, 0.0] });
        let exact: Vec<Influences> = coarse().positions.iter().map(at).collect();
        let fitted = fit(&source, &poses, &coarse(), exact.clone(), LIMITS);
        assert!(fitted.iter().zip(&exact).all(|(a, b)| (second(a) - second(b)).abs() < 1e-4), "{fitted:?}");
    }
}
