//! How much more than others some parts of a source count: "keep the face".

use glam::Vec3;

use crate::Error;
use crate::animation::{Motions, Poses};
use crate::data::{Model, TriMesh};
use crate::geometry::Bvh;
use crate::render::{EMPTY_PIXEL, Raster, View};
use crate::settings::BakeSettings;

/// Weights of a source's triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance(Vec<f32>);

impl Importance {
    /// By the names of materials and by what is painted into the second vertex colour; `None` if all count alike.
    ///
    /// # Errors
    /// If a glob is malformed.
    pub fn of(model: &Model, settings: &BakeSettings) -> Result<Option<Self>, Error> {
        let mut by_material = vec![1.0; model.materials.len()];
        for importance in &settings.importance {
            let matcher = importance
                .matcher()
                .ok_or_else(|| Error::Settings(format!("importance: '{}' is no glob", importance.material)))?;
            for (weight, material) in by_material.iter_mut().zip(&model.materials) {
                if matcher.is_match(&material.name) {
                    *weight = importance.weight;
                }
            }
        }
        let surface = &model.surface;
        let painted = |triangle: &[u32; 3]| {
            let red: f32 = triangle.iter().map(|&v| surface.painted.get(v as usize).copied().unwrap_or(0.0)).sum();
            libm::powf(settings.painted_importance, red / 3.0)
        };
        let faces = surface.triangles.iter().zip(&surface.material);
        let weights: Vec<f32> = faces.map(|(t, &m)| by_material.get(m as usize).unwrap_or(&1.0) * painted(t)).collect();
        Ok(weights.iter().any(|w| *w != 1.0).then_some(Self(weights)))
    }

    /// By triangle of the source.
    pub(crate) fn weights(&self) -> &[f32] {
        &self.0
    }

    /// The weight of each face of a mesh near the source: that of the triangle of `bvh`, over the source, nearest to its
    /// middle.
    pub(super) fn of_faces(&self, mesh: &TriMesh, bvh: &Bvh) -> Vec<f64> {
        let middle = |t: usize| mesh.corners(t).iter().sum::<Vec3>() / 3.0;
        let near = |t: usize| bvh.closest(middle(t), f32::INFINITY).map_or(1.0, |hit| self.0[hit.triangle as usize]);
        (0..mesh.triangles.len()).map(|t| f64::from(near(t))).collect()
    }

    /// The weight of each pixel of a view: that of the triangle seen there, one beside the source.
    pub(super) fn of_pixels(&self, model: &Model, poses: Option<&Poses<'_>>, views: &[&View]) -> Vec<Vec<f32>> {
        let surface = &model.surface;
        let motions = poses.map_or_else(Motions::default, |poses| poses.motions(&surface.influences));
        let mut clip = Vec::new();
        let mut weights = |view: &&View| {
            motions.project(&surface.positions, &view.camera.view_projection, view.pose, &mut clip);
            let mut raster = Raster::new(view.image.size);
            raster.draw(&clip, &surface.triangles, |t| model.material_of(t as u32).double_sided);
            raster.ids.iter().map(|&id| if id == EMPTY_PIXEL { 1.0 } else { self.0[id as usize] }).collect()
        };
        views.iter().map(&mut weights).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Material, Surface};
    use crate::settings;

    /// Two squares of two triangles, side by side: the left one is of `Face`.
    fn squares() -> Model {
        let positions = (0..6).map(|i| Vec3::new((i % 3) as f32, (i / 3) as f32, 0.0)).collect();
        let surface = Surface {
            positions,
            normals: vec![Vec3::Z; 6],
            triangles: vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
            material: vec![0, 0, 1, 1],
            ..Surface::default()
        };
        let named = |name: &str| Material { name: name.into(), ..Material::default() };
        Model { surface, materials: vec![named("HeroFace"), named("Coat")], ..Model::empty("squares") }
    }

    fn settings(weight: f32) -> BakeSettings {
        let importance = vec![settings::Importance { material: "*Face".into(), weight }];
        BakeSettings { importance, painted_importance: 4.0, ..BakeSettings::default() }
    }

    #[test]
    fn all_count_alike_by_default() {
        assert_eq!(Importance::of(&squares(), &BakeSettings::default()).expect("sound"), None);
    }

    #[test]
    fn materials_count_by_name_and_vertices_by_paint() {
        let mut model = squares();
        assert_eq!(Importance::of(&model, &settings(3.0)).expect("sound"), Some(Importance(vec![3.0, 3.0, 1.0, 1.0])));
        model.surface.painted = vec![0.0, 0.0, 1.0, 0.0, 0.0, 0.5];
        let weights = Importance::of(&model, &settings(1.0)).expect("sound").expect("painted").0;
        assert_eq!(weights[..2], [1.0, 1.0]);
        assert!((weights[2] - 2.0).abs() < 1e-5 && weights[3] > 1.0 && weights[3] < 2.0, "{weights:?}");
    }

    #[test]
    fn faces_and_pixels_take_the_weight_of_what_is_there() {
        let model = squares();
        let importance = Importance::of(&model, &settings(3.0)).expect("sound").expect("named");
        let mesh = TriMesh { positions: model.surface.positions.clone(), triangles: vec![[1, 2, 5], [0, 1, 3]] };
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        assert_eq!(importance.of_faces(&mesh, &bvh), [1.0, 3.0]);
        let sampler = crate::render::SurfaceSampler::new(&model);
        let camera = crate::render::Camera::orbit(
            &crate::geometry::BoundingSphere::around(&model.surface.positions),
            Vec3::Z,
            0.6,
            1.0,
        );
        let views = crate::render::take_views(&sampler, &[camera], 64);
        let weights = &importance.of_pixels(&model, None, &[&views[0]])[0];
        let row = &weights[32 * 64..33 * 64];
        assert_eq!((row[0], row[26], row[38], row[63]), (1.0, 3.0, 1.0, 1.0));
    }
}
