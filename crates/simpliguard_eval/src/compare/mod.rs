//! Comparison of levels with their source: likeness of their pictures, and distance of their surfaces.
//!
//! The views, the background, the grid and the units are those of the benchmark that `docs/results.md` describes. That page
//! also says how closely the figures agree.

mod distance;
pub(crate) mod flip;
pub(crate) mod image;
mod motion;
pub(crate) mod plane;
pub(crate) mod views;
mod volume;
mod winding;

use rayon::prelude::*;
use serde::Serialize;
use simpliguard::data::{Model, TriMesh};

pub use distance::Distances;
pub use motion::MotionMetrics;
pub use views::{ImageMetrics, PerceptualMetrics, cameras};

use crate::lpips::Lpips;
use distance::DistanceMetric;
use views::view_metrics;
use volume::Grid;

/// Views of the paper.
pub const VIEWS: usize = 80;

/// Options of a comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options<'a> {
    /// Number of views of the rest pose.
    pub views: usize,
    /// Also compare the volumes. It takes longer than all the rest.
    pub volume: bool,
    /// Also compare frames of the clips.
    pub motion: bool,
    /// Also compare the features of this network. It takes about a second for each view and level.
    pub lpips: Option<&'a Lpips>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self { views: VIEWS, volume: true, motion: false, lpips: None }
    }
}

/// A level beside its source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Triangles of the level.
    pub faces: usize,
    /// Base colour alone.
    pub unlit: ImageMetrics,
    /// Under a lamp at the camera.
    pub lit: ImageMetrics,
    /// By the features of a network, without light; `None` if that was not asked for.
    pub perceptual: Option<PerceptualMetrics>,
    /// Intersection over union of the silhouettes, mean over the views.
    pub silhouette_iou: f64,
    /// Intersection over union of the volumes, on a grid with 128 voxels along the source's longest side. A voxel is inside
    /// if the generalized winding number at its centre is above a half, with either sign. An open or thin source has an
    /// inside by chance. `None` if neither has an inside, or if it was not asked for.
    pub iou_3d: Option<f64>,
    /// Distances between the surfaces; `None` if one has no area.
    pub distances: Option<Distances>,
    /// In motion; `None` if that was not asked for, or if there is no clip that moves both.
    pub motion: Option<MotionMetrics>,
}

/// Compares levels with their source.
pub fn compare(source: &Model, levels: &[&Model], options: &Options<'_>) -> Vec<Comparison> {
    let mesh = mesh_of(source);
    let inside = Grid::around(&mesh).filter(|_| options.volume).map(|grid| (grid, grid.occupancy(&mesh)));
    let metric = DistanceMetric::new(&mesh);
    let views = view_metrics(source, levels, options.views, options.lpips);
    let compare = |(level, metrics): (&&Model, views::ViewMetrics)| {
        let mesh = mesh_of(level);
        Comparison {
            faces: mesh.triangles.len(),
            unlit: metrics.unlit,
            lit: metrics.lit,
            perceptual: metrics.perceptual,
            silhouette_iou: metrics.silhouette_iou,
            iou_3d: inside.as_ref().and_then(|(grid, inside)| inside.iou(&grid.occupancy(&mesh))),
            distances: metric.as_ref().and_then(|metric| metric.measure(&mesh)),
            motion: if options.motion { motion::motion(source, level) } else { None },
        }
    };
    levels.par_iter().zip(views).map(compare).collect()
}

/// The triangles of a model, and the vertices that they use.
fn mesh_of(model: &Model) -> TriMesh {
    let surface = &model.surface;
    let all = TriMesh { positions: surface.positions.clone(), triangles: surface.triangles.clone() };
    all.filtered(|_| true)
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, Vec4};
    use simpliguard::data::{Material, Surface};

    use super::volume::tests::cuboid;
    use super::*;

    fn model(low: Vec3, high: Vec3) -> Model {
        let mesh = cuboid(low, high);
        let surface = Surface {
            normals: mesh.vertex_normals(),
            material: vec![0; mesh.triangles.len()],
            positions: mesh.positions,
            triangles: mesh.triangles,
            ..Surface::default()
        };
        let red = Material { base_color: Vec4::new(1.0, 0.0, 0.0, 1.0), ..Material::default() };
        Model { surface, materials: vec![red], ..Model::empty("box") }
    }

    const FEW: Options<'_> = Options { views: 4, volume: true, motion: true, lpips: None };

    #[test]
    fn a_model_is_like_itself() {
        let source = model(-Vec3::ONE, Vec3::ONE);
        let found = compare(&source, &[&source, &Model::empty("nothing")], &FEW);
        let alike = ImageMetrics { psnr: 100.0, psnr_foreground: 100.0, ssim: 1.0, flip: 0.0 };
        assert!((found[0].unlit.ssim - 1.0).abs() < 1e-6 && (found[0].lit.ssim - 1.0).abs() < 1e-6);
        assert_eq!(ImageMetrics { ssim: 1.0, ..found[0].unlit }, alike);
        assert_eq!((found[0].silhouette_iou, found[0].iou_3d, found[0].motion), (1.0, Some(1.0), None));
        assert!(found[0].distances.is_some_and(|d| d.hausdorff < 1e-6));
        assert_eq!((found[1].faces, found[1].silhouette_iou, found[1].iou_3d), (0, 0.0, Some(0.0)));
        assert!(found[1].distances.is_none() && found[1].unlit.psnr < 15.0);
    }

    #[test]
    fn a_network_sees_what_is_missing() {
        let lpips = crate::lpips::tests::made_up();
        let source = model(-Vec3::ONE, Vec3::ONE);
        let half = model(-Vec3::ONE, Vec3::new(0.0, 1.0, 1.0));
        let options = Options { views: 1, volume: false, motion: false, lpips: Some(&lpips) };
        let found = compare(&source, &[&source, &half], &options);
        let [alike, less] = [0, 1].map(|i| found[i].perceptual.expect("asked for"));
        assert_eq!(alike, PerceptualMetrics { lpips: 0.0, nlpips: 1.0 });
        assert!(less.lpips > 0.0 && less.nlpips < 1.0 && less.nlpips > 0.0, "{less:?}");
        assert_eq!(compare(&source, &[&half], &Options { lpips: None, ..options })[0].perceptual, None);
    }

    #[test]
    fn half_a_box_has_half_the_volume() {
        let source = model(-Vec3::ONE, Vec3::ONE);
        let half = model(-Vec3::ONE, Vec3::new(0.0, 1.0, 1.0));
        let found = compare(&source, &[&half], &FEW)[0];
        assert!(found.iou_3d.is_some_and(|iou| (iou - 0.5).abs() < 0.01), "{:?}", found.iou_3d);
        // The farthest points are those of the removed side.
        let far = 1.0 / 12f64.sqrt();
        assert!(found.distances.is_some_and(|d| (d.hausdorff - far).abs() < 1e-3), "{:?}", found.distances);
        assert!(found.unlit.psnr > found.unlit.psnr_foreground && found.unlit.flip > 0.0);
    }
}
