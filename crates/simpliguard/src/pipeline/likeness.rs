//! How much a level looks like its source, from views that nothing was chosen by or fitted to.

use glam::Vec4;
use rayon::prelude::*;

use super::report::{Likeness, WrongMaterial};
use super::runner::Runner;
use super::source::SourceIndex;
use crate::data::{Level, Model};
use crate::render::{
    Camera, Image, Light, Pool, Renderer, SurfaceSampler, ViewParams, decibels, difference_over, viewpoints,
};
use crate::{Cancellation, StageId};

/// Number of views.
const VIEWS: usize = 8;
/// Largest side of a view in pixels. It has half the side of the views that the level was fitted to, if that is smaller.
const SIZE: usize = 256;
/// Added to the seed of the views that stages are given.
const OTHER_SEED: u64 = 3;
/// Without and with light.
const LIGHTS: [Light; 2] = [Light::None, Light::Head];
/// Backgrounds: on one alone, what has its colour would not count.
const BACKGROUNDS: [f32; 2] = [0.0, 1.0];
/// Error of a colour channel, 0 to 1 of the encoded scale, from which on a pixel is wrong.
const WRONG: f32 = 0.2;
/// Alpha of a pixel that counts to the silhouette.
const COVERED: u8 = 128;

/// Pictures of a source, for comparison with those of its levels.
pub(super) struct SourcePictures<'a> {
    model: &'a Model,
    /// Side of the pictures in pixels.
    size: usize,
    views: Vec<SourceView>,
    cancellation: &'a Cancellation,
}

struct SourceView {
    camera: Camera,
    /// One for each of [`LIGHTS`].
    images: [Image; 2],
    /// The material that each pixel shows; `None` behind clear surfaces alone, and where nothing is.
    materials: Vec<Option<u32>>,
}

/// Sums over the pixels of one view.
#[derive(Default)]
struct Comparison {
    errors: [f64; 2],
    touched: usize,
    both: usize,
    either: usize,
    /// Pixels of each material of the source, and those that are wrong.
    materials: Vec<[usize; 2]>,
}

impl<'a> SourcePictures<'a> {
    /// Pictures of a whole source.
    pub(super) fn of(index: &SourceIndex<'a>, params: &ViewParams, run: &'a Runner<'_>) -> Self {
        run.time(StageId::Views, || {
            let cameras = viewpoints(&index.sphere, VIEWS, index.seed.wrapping_add(OTHER_SEED));
            Self::take(index.whole, cameras, (params.size as usize / 2).min(SIZE), run.cancellation())
        })
    }

    /// Takes the pictures of a model, `size` pixels wide and high; fewer if cancelled.
    fn take(model: &'a Model, cameras: Vec<Camera>, size: usize, cancellation: &'a Cancellation) -> Self {
        let sampler = SurfaceSampler::new(model);
        let renderers = Pool::new();
        let draw = |renderer: &mut Renderer<'_>, camera: Camera| {
            let images = renderer.draw(&camera, LIGHTS);
            let material = |i| Some(model.surface.material[renderer.solid_triangle(i % size, i / size)?]);
            let materials = (0..size * size).map(material).collect();
            SourceView { camera, images, materials }
        };
        let new = || Renderer::new(&sampler, size, 2);
        let view = |camera| renderers.with(new, |renderer| draw(renderer, camera));
        let cameras = cameras.into_par_iter().filter(|_| !cancellation.is_cancelled());
        let views = cameras.map(view).collect();
        Self { model, size, views, cancellation }
    }

    /// The source has normal maps.
    pub(super) fn have_normal_maps(&self) -> bool {
        self.model.materials.iter().any(|material| material.normal_texture.is_some())
    }

    /// Compares a level with the source; by fewer views if cancelled.
    pub(super) fn compare(&self, level: &Level) -> Likeness {
        let level = level.to_model(self.model);
        let sampler = SurfaceSampler::new(&level);
        let (renderers, new) = (Pool::new(), || Renderer::new(&sampler, self.size, 2));
        let compare = |view: &SourceView| {
            self.compare_view(view, &renderers.with(new, |renderer| renderer.draw(&view.camera, LIGHTS)))
        };
        let views = self.views.par_iter().filter(|_| !self.cancellation.is_cancelled());
        let compared: Vec<Comparison> = views.map(compare).collect();
        self.summary(&compared)
    }

    fn compare_view(&self, view: &SourceView, level: &[Image; 2]) -> Comparison {
        let mut out = Comparison { materials: vec![[0; 2]; self.model.materials.len()], ..Comparison::default() };
        for i in 0..self.size * self.size {
            let [a, b] = [view.images[0].pixels[i][3], level[0].pixels[i][3]];
            if a == 0 && b == 0 {
                continue;
            }
            let differences = [0, 1].map(|light| view.images[light].at(i) - level[light].at(i));
            out.touched += 1;
            out.both += usize::from(a >= COVERED && b >= COVERED);
            out.either += usize::from(a >= COVERED || b >= COVERED);
            out.errors.iter_mut().zip(differences).for_each(|(sum, d)| *sum += f64::from(squared_error(d)));
            if let Some(material) = view.materials[i] {
                let count = &mut out.materials[material as usize];
                count[0] += 1;
                count[1] += usize::from(is_wrong(differences[0]));
            }
        }
        out
    }

    fn summary(&self, views: &[Comparison]) -> Likeness {
        let count = views.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Comparison) -> f64| (views.iter().map(of).sum::<f64>() / count) as f32;
        let psnr = |light: usize| mean(&|view| decibels(view.errors[light] / view.touched.max(1) as f64));
        let iou = |view: &Comparison| if view.either == 0 { 1.0 } else { view.both as f64 / view.either as f64 };
        let pixels = |m: usize| {
            let sum = |i: usize| views.iter().map(|view| view.materials[m][i]).sum::<usize>();
            [sum(0), sum(1)]
        };
        let worst = (0..self.model.materials.len()).map(|m| (m, pixels(m))).max_by_key(|(m, p)| (p[1], usize::MAX - m));
        let worst = worst.filter(|(_, [_, wrong])| *wrong > 0).map(|(m, [all, wrong])| {
            let name = &self.model.materials[m].name;
            let material = if name.is_empty() { m.to_string() } else { name.clone() };
            WrongMaterial { material, wrong: wrong as f32 / all as f32 }
        });
        let both = |view: &Comparison| decibels(0.5 * (view.errors[0] + view.errors[1]) / view.touched.max(1) as f64);
        let psnr_worst = views.iter().map(both).fold(f64::INFINITY, f64::min).min(decibels(0.0)) as f32;
        Likeness { psnr: psnr(0), psnr_lit: psnr(1), psnr_worst, silhouette_iou: mean(&iou), worst }
    }
}

/// Mean over the backgrounds and channels, for a difference of premultiplied colours.
fn squared_error(difference: Vec4) -> f32 {
    BACKGROUNDS.map(|b| difference_over(difference, b).length_squared()).iter().sum::<f32>()
        / (3 * BACKGROUNDS.len()) as f32
}

fn is_wrong(difference: Vec4) -> bool {
    BACKGROUNDS.iter().any(|b| difference_over(difference, *b).abs().max_element() > WRONG)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::data::{Material, Surface};
    use crate::geometry::BoundingSphere;

    /// Two squares side by side, of two materials.
    fn squares(colors: [f32; 2]) -> Model {
        let corners = |x: f32| [[x, 0.0], [x + 1.0, 0.0], [x + 1.0, 1.0], [x, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let surface = Surface {
            positions: [corners(-1.0), corners(0.0)].concat(),
            normals: vec![Vec3::Z; 8],
            triangles,
            material: vec![0, 0, 1, 1],
            ..Surface::default()
        };
        let material = |(name, color): (&str, f32)| Material {
            name: name.into(),
            base_color: Vec4::new(color, color, color, 1.0),
            double_sided: true,
            ..Material::default()
        };
        let materials = [("left", colors[0]), ("", colors[1])].map(material).to_vec();
        Model { surface, materials, ..Model::empty("squares") }
    }

    fn compare(source: &Model, other: &Model) -> Likeness {
        let sphere = BoundingSphere::around(&source.surface.positions);
        let cancellation = Cancellation::default();
        let cameras = || viewpoints(&sphere, VIEWS, 1);
        let [a, b] = [source, other].map(|model| SourcePictures::take(model, cameras(), SIZE, &cancellation));
        let views = a.views.iter().zip(&b.views).map(|(view, other)| a.compare_view(view, &other.images));
        a.summary(&views.collect::<Vec<_>>())
    }

    #[test]
    fn a_model_is_like_itself() {
        let model = squares([0.2, 1.0]);
        let likeness = compare(&model, &model);
        assert_eq!(
            likeness,
            Likeness { psnr: 100.0, psnr_lit: 100.0, psnr_worst: 100.0, silhouette_iou: 1.0, worst: None }
        );
        assert_eq!(likeness.warning(1, 12.0), None);
    }

    #[test]
    fn the_material_with_the_wrong_pixels_is_named() {
        let likeness = compare(&squares([0.2, 1.0]), &squares([0.2, 0.0]));
        let Some(WrongMaterial { material, wrong }) = &likeness.worst else { panic!("{likeness:?}") };
        assert!(material == "1" && *wrong > 0.95, "{likeness:?}");
        // Half of the pixels have the largest error.
        assert!((likeness.psnr - 3.0).abs() < 1.5 && likeness.silhouette_iou == 1.0, "{likeness:?}");
        let warning = likeness.warning(2, 12.0).expect("below");
        assert!(
            warning.starts_with("LOD2 hardly looks like its source") && warning.contains("material '1'"),
            "{warning}"
        );
    }

    #[test]
    fn what_is_white_on_white_is_seen_on_black() {
        let mut without = squares([1.0, 1.0]);
        without.surface.triangles.truncate(2);
        without.surface.material.truncate(2);
        let likeness = compare(&squares([1.0, 1.0]), &without);
        assert!(likeness.psnr < 7.0 && (likeness.silhouette_iou - 0.5).abs() < 0.15, "{likeness:?}");
    }
}
