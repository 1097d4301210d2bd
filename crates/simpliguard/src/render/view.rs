//! What the source looks like from the cameras that every later stage is judged by.

use glam::{Affine3A, Vec3, Vec4};
use rayon::prelude::*;

use super::{Camera, Light, Picture, Renderer, SurfaceSampler};

/// A camera and the source's unlit picture from it.
pub struct View {
    /// Where it was taken from.
    pub camera: Camera,
    /// The pose the source was in, as in [`Motions`]; `None` for the rest pose.
    pub pose: Option<usize>,
    /// The source, premultiplied over nothing.
    pub picture: Picture,
    /// The source's normals, as [`Light::Normals`], where they count.
    pub normals: Option<Picture>,
}

/// Takes the source's picture from every camera, `size` pixels wide, each the mean of 2 x 2 points.
pub fn take_views(sampler: &SurfaceSampler<'_>, cameras: &[Camera], size: usize) -> Vec<View> {
    take(sampler, &sampler.model().surface.positions, cameras, size, None)
}

/// As [`take_views`], with the source's vertices where `pose` takes them.
pub fn take_posed_views(
    sampler: &SurfaceSampler<'_>,
    positions: &[Vec3],
    pose: usize,
    cameras: &[Camera],
    size: usize,
) -> Vec<View> {
    take(sampler, positions, cameras, size, Some(pose))
}

/// The same views at half the size, with the source's normals if `normals`; `posed` has the source's vertices in a pose.
/// None if the size is odd.
pub fn halve_views(
    sampler: &SurfaceSampler<'_>,
    views: &[View],
    posed: impl Fn(usize) -> Vec<Vec3> + Sync,
    normals: bool,
) -> Vec<View> {
    let size = views.first().map_or(0, |view| view.picture.size / 2);
    let halve = |renderer: &mut Renderer<'_>, view: &View| {
        let picture = view.picture.halved()?;
        let normals = normals.then(|| match view.pose {
            None => renderer.draw(&view.camera, Light::Normals),
            Some(pose) => renderer.draw_moved(&posed(pose), &view.camera, Light::Normals),
        });
        Some(View { camera: view.camera, pose: view.pose, picture, normals })
    };
    let halved: Option<Vec<View>> = views.par_iter().map_init(|| Renderer::new(sampler, size, 2), halve).collect();
    halved.unwrap_or_default()
}

fn take(
    sampler: &SurfaceSampler<'_>,
    positions: &[Vec3],
    cameras: &[Camera],
    size: usize,
    pose: Option<usize>,
) -> Vec<View> {
    let view = |renderer: &mut Renderer<'_>, camera: &Camera| {
        let picture = renderer.draw_moved(positions, camera, Light::None);
        View { camera: *camera, pose, picture, normals: None }
    };
    cameras.par_iter().map_init(|| Renderer::new(sampler, size, 2), view).collect()
}

/// How the vertices of one mesh move from the rest pose into each pose that views are taken in. Empty for a mesh that
/// keeps still.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motions(Vec<Vec<Affine3A>>);

impl Motions {
    /// By pose, then by vertex.
    pub fn new(poses: Vec<Vec<Affine3A>>) -> Self {
        Self(poses)
    }

    /// The motion of each vertex into a pose; `None` if it stays in the rest pose.
    pub fn of(&self, pose: Option<usize>) -> Option<&[Affine3A]> {
        self.0.get(pose?).map(Vec::as_slice)
    }

    /// Replaces the motions into a pose.
    pub fn set(&mut self, pose: usize, motions: Vec<Affine3A>) {
        self.0[pose] = motions;
    }

    /// The same motions of positions in another space, which `to_world` leads out of.
    pub fn rebased(mut self, to_world: Affine3A) -> Self {
        let from_world = to_world.inverse();
        self.0.iter_mut().flatten().for_each(|motion| *motion = from_world * *motion * to_world);
        self
    }

    /// Positions of the rest pose as a camera sees them in `pose`: replaces `clip`.
    pub fn project(&self, positions: &[Vec3], camera: &Camera, pose: Option<usize>, clip: &mut Vec<Vec4>) {
        let matrix = camera.view_projection;
        clip.clear();
        match self.of(pose) {
            None => clip.extend(positions.iter().map(|p| matrix * p.extend(1.0))),
            Some(motions) => {
                let moved = positions.iter().zip(motions).map(|(p, motion)| motion.transform_point3(*p));
                clip.extend(moved.map(|p| matrix * p.extend(1.0)));
            }
        }
    }
}
