//! Comparison in motion: frames of the source's clips.

use glam::{Affine3A, Mat3A};
use rayon::prelude::*;
use serde::Serialize;
use simpliguard::animation::LinearBlend;
use simpliguard::data::{Model, Pose};
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Light, Renderer, SurfaceSampler};

use super::image::Pair;
use super::views::{SAMPLES, SIZE, cameras, mean};

/// Views of each frame.
const VIEWS: usize = 20;
/// Frames at times that differ by less, in seconds, are the same.
const SAME_TIME: f32 = 1e-3;

/// Means over frames of the clips.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MotionMetrics {
    /// Number of frames.
    pub frames: usize,
    /// PSNR in dB, base colour alone.
    pub psnr: f64,
    /// The same over the pixels that the source or the level touches.
    pub psnr_foreground: f64,
    /// PSNR in dB under a lamp at the camera. Normals move with the vertices.
    pub psnr_lit: f64,
    /// Intersection over union of the silhouettes.
    pub silhouette_iou: f64,
    /// Loss of foreground PSNR in the worst frame against the rest pose, in dB, base colour alone.
    pub worst_drop: f64,
    /// The same under the lamp.
    pub worst_drop_lit: f64,
}

/// Means over the views of one frame.
#[derive(Clone, Copy, Default)]
struct Frame {
    psnr: f64,
    psnr_foreground: f64,
    psnr_lit: f64,
    psnr_foreground_lit: f64,
    silhouette_iou: f64,
}

/// Compares a level with its source in frames of the clips that both have. `None` if there are none.
pub(crate) fn motion(source: &Model, level: &Model) -> Option<MotionMetrics> {
    let models = [source, level];
    let [of_source, of_level] = models.map(LinearBlend::of);
    let blends = [of_source?, of_level?];
    let [of_source, of_level] = blends.each_ref().map(LinearBlend::poses);
    let both = of_source.iter().filter_map(|pose| Some([pose, same_frame(pose, of_level)?]));
    let posed = both.map(|poses| Frame::of(&[0, 1].map(|i| in_pose(models[i], &blends[i], poses[i])).each_ref()));
    let posed: Vec<Frame> = posed.collect();
    (!posed.is_empty()).then(|| MotionMetrics::of(Frame::of(&models), &posed))
}

impl MotionMetrics {
    fn of(rest: Frame, posed: &[Frame]) -> Self {
        let worst = |of: fn(&Frame) -> f64| posed.iter().map(|frame| of(&rest) - of(frame)).fold(f64::MIN, f64::max);
        let Frame { psnr, psnr_foreground, psnr_lit, silhouette_iou, .. } = Frame::mean(posed);
        Self {
            frames: posed.len(),
            psnr,
            psnr_foreground,
            psnr_lit,
            silhouette_iou,
            worst_drop: worst(|frame| frame.psnr_foreground),
            worst_drop_lit: worst(|frame| frame.psnr_foreground_lit),
        }
    }
}

/// The pose among `all` at the same moment of the same clip.
fn same_frame<'p>(pose: &Pose, all: &'p [Pose]) -> Option<&'p Pose> {
    let (clip, time) = pose.frame?;
    all.iter().find(|other| other.frame.is_some_and(|(c, t)| c == clip && (t - time).abs() < SAME_TIME))
}

/// A model whose vertices, normals and tangents have moved into a pose.
fn in_pose(model: &Model, blend: &LinearBlend<'_>, pose: &Pose) -> Model {
    let mut surface = model.surface.clone();
    let motions = blend.motions(&blend.bones(pose), &blend.bind(&surface.influences));
    for (position, motion) in surface.positions.iter_mut().zip(&motions) {
        *position = motion.transform_point3(*position);
    }
    for (normal, motion) in surface.normals.iter_mut().zip(&motions) {
        *normal = (for_normals(motion) * *normal).normalize_or(*normal);
    }
    for (tangent, motion) in surface.tangents.iter_mut().zip(&motions) {
        let along = tangent.truncate();
        *tangent = motion.transform_vector3(along).normalize_or(along).extend(tangent.w);
    }
    model.with_surface(surface, model.materials.clone())
}

/// The matrix that turns normals: the inverse transpose times the determinant, up to the sign. It also exists where a motion
/// has no inverse.
fn for_normals(motion: &Affine3A) -> Mat3A {
    let Mat3A { x_axis: x, y_axis: y, z_axis: z } = motion.matrix3;
    Mat3A::from_cols(y.cross(z), z.cross(x), x.cross(y)) * x.cross(y).dot(z).signum()
}

impl Frame {
    /// A source and its level over views that are framed on the source.
    fn of(models: &[&Model; 2]) -> Self {
        let samplers = models.map(SurfaceSampler::new);
        let renderers = || samplers.each_ref().map(|sampler| Renderer::new(sampler, SIZE, SAMPLES));
        let view = |renderers: &mut [Renderer<'_>; 2], camera: &Camera| {
            let [a, b] = renderers.each_mut().map(|renderer| renderer.draw(camera, [Light::None, Light::Head]));
            let [unlit, lit] = [0, 1].map(|light| Pair::new(&a[light], &b[light]));
            Self {
                psnr: unlit.psnr(),
                psnr_foreground: unlit.psnr_foreground(),
                psnr_lit: lit.psnr(),
                psnr_foreground_lit: lit.psnr_foreground(),
                silhouette_iou: unlit.silhouette_iou(),
            }
        };
        let cameras = cameras(&BoundingSphere::around(&models[0].surface.positions), VIEWS);
        let views: Vec<Self> = cameras.par_iter().map_init(renderers, view).collect();
        Self::mean(&views)
    }

    fn mean(all: &[Self]) -> Self {
        let of = |figure: fn(&Self) -> f64| mean(all.iter().map(figure));
        Self {
            psnr: of(|frame| frame.psnr),
            psnr_foreground: of(|frame| frame.psnr_foreground),
            psnr_lit: of(|frame| frame.psnr_lit),
            psnr_foreground_lit: of(|frame| frame.psnr_foreground_lit),
            silhouette_iou: of(|frame| frame.silhouette_iou),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, Quat, Vec3, Vec4};
    use simpliguard::data::{Bone, Influences, Material, Rig, Surface};

    use super::*;

    /// A square with tilted normals, and one frame in which its bone has moved it.
    fn square(motion: Mat4) -> Model {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let surface = Surface {
            positions: corners.to_vec(),
            normals: vec![Vec3::new(0.6, 0.0, 0.8); 4],
            tangents: vec![Vec4::new(0.8, 0.0, -0.6, -1.0); 4],
            influences: vec![Influences { joints: [0; 4], weights: [1.0, 0.0, 0.0, 0.0] }; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material: vec![0; 2],
            ..Surface::default()
        };
        let bones = vec![Bone { node: 0, inverse_bind: Mat4::IDENTITY, rest_world: Mat4::IDENTITY }];
        let poses = vec![Pose { frame: Some((0, 0.5)), world: vec![motion] }];
        let rig = Some(Rig { bones, source_skin: Some(0), poses });
        Model { surface, materials: vec![Material::default()], rig, ..Model::empty("square") }
    }

    #[test]
    fn normals_and_tangents_move_with_their_vertices() {
        let moved = |motion| {
            let model = square(motion);
            let blend = LinearBlend::of(&model).expect("a bone");
            let surface = in_pose(&model, &blend, &blend.poses()[0]).surface;
            (surface.positions[1], surface.normals[0], surface.tangents[0])
        };
        let is_near = |a: Vec3, b: [f32; 3]| a.distance(Vec3::from(b)) < 1e-5;
        let (position, normal, tangent) = moved(Mat4::from_quat(Quat::from_rotation_y(std::f32::consts::FRAC_PI_2)));
        assert!(is_near(position, [0.0, -1.0, -1.0]) && is_near(normal, [0.8, 0.0, -0.6]), "{position} {normal}");
        assert!(is_near(tangent.truncate(), [-0.6, 0.0, -0.8]) && tangent.w < 0.0, "{tangent}");
        // A normal stays upright on its tangents where they are stretched, also by a motion without an inverse.
        for motion in [Mat4::from_scale(Vec3::new(3.0, 1.0, 0.5)), Mat4::from_scale(Vec3::new(3.0, 1.0, 0.0))] {
            let (_, normal, tangent) = moved(motion);
            assert!(normal.is_normalized() && normal.dot(tangent.truncate()).abs() < 1e-5, "{normal} {tangent}");
        }
    }

    #[test]
    fn a_frame_may_differ_under_light_alone() {
        let source = square(Mat4::IDENTITY);
        let alike = motion(&source, &source).expect("a frame");
        assert_eq!((alike.frames, alike.psnr_lit, alike.worst_drop, alike.worst_drop_lit), (1, 100.0, 0.0, 0.0));
        // The square is flat: this stretch moves no vertex, but turns the normals.
        let stretched = motion(&source, &square(Mat4::from_scale(Vec3::new(1.0, 1.0, 4.0)))).expect("a frame");
        assert_eq!((stretched.psnr, stretched.worst_drop), (100.0, 0.0));
        assert!(stretched.psnr_lit < 80.0 && stretched.worst_drop_lit > 20.0, "{stretched:?}");
    }
}
