//! Weights of the source's triangles: the face of a character may count more than its coat.

use glam::Vec3;
use serde::Serialize;

use crate::Error;
use crate::animation::{Motions, Poses};
use crate::data::{MaterialWeight, Model, TriMesh};
use crate::geometry::Bvh;
use crate::render::{EMPTY_PIXEL, Raster, View};

/// Parameters of the weights: by material and by paint.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImportanceParams {
    /// The last entry that matches a material's name applies.
    pub materials: Vec<MaterialWeight>,
    /// Weight where the red channel of the second vertex colour is one.
    pub painted: f32,
}

/// The weight of each triangle of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance(Vec<f32>);

impl Importance {
    /// Weights from the names of materials and from the second vertex colour; `None` if all triangles count alike.
    ///
    /// # Errors
    /// If a glob is malformed.
    pub fn of(model: &Model, params: &ImportanceParams) -> Result<Option<Self>, Error> {
        let mut by_material = vec![1.0; model.materials.len()];
        for group in &params.materials {
            let matcher = group
                .matcher()
                .ok_or_else(|| Error::Settings(format!("importance: '{}' is not a glob", group.material)))?;
            for (weight, material) in by_material.iter_mut().zip(&model.materials) {
                if matcher.is_match(&material.name) {
                    *weight = group.weight;
                }
            }
        }
        let surface = &model.surface;
        let painted = |triangle: &[u32; 3]| {
            let red: f32 = triangle.iter().map(|&v| surface.painted.get(v as usize).copied().unwrap_or(0.0)).sum();
            libm::powf(params.painted, red / 3.0)
        };
        let faces = surface.triangles.iter().zip(&surface.material);
        let weights: Vec<f32> = faces.map(|(t, &m)| by_material.get(m as usize).unwrap_or(&1.0) * painted(t)).collect();
        Ok(weights.iter().any(|w| *w != 1.0).then_some(Self(weights)))
    }

    /// The weight of each triangle of the source.
    pub(crate) fn weights(&self) -> &[f32] {
        &self.0
    }

    /// Weights of the faces of a mesh near the source. Each face takes the weight of the source's triangle that is
    /// nearest to the face's centroid. `bvh` holds the triangles of the source.
    pub(super) fn of_faces(&self, mesh: &TriMesh, bvh: &Bvh) -> Vec<f64> {
        let centroid = |t: usize| mesh.corners(t).iter().sum::<Vec3>() / 3.0;
        let weight =
            |t: usize| bvh.closest(centroid(t), f32::INFINITY).map_or(1.0, |hit| self.0[hit.triangle as usize]);
        (0..mesh.triangles.len()).map(|t| f64::from(weight(t))).collect()
    }

    /// Weights of the pixels of each view: the weight of the visible triangle, or one where the view does not show the
    /// source.
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

    /// Two squares of two triangles, side by side. The left one has the material `HeroFace`.
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

    fn params(weight: f32) -> ImportanceParams {
        ImportanceParams { materials: vec![MaterialWeight { material: "*Face".into(), weight }], painted: 4.0 }
    }

    #[test]
    fn all_count_alike_by_default() {
        assert_eq!(
            Importance::of(&squares(), &ImportanceParams { materials: Vec::new(), painted: 1.0 }).expect("sound"),
            None
        );
    }

    #[test]
    fn materials_count_by_name_and_vertices_by_paint() {
        let mut model = squares();
        assert_eq!(Importance::of(&model, &params(3.0)).expect("sound"), Some(Importance(vec![3.0, 3.0, 1.0, 1.0])));
        model.surface.painted = vec![0.0, 0.0, 1.0, 0.0, 0.0, 0.5];
        let weights = Importance::of(&model, &params(1.0)).expect("sound").expect("painted").0;
        assert_eq!(weights[..2], [1.0, 1.0]);
        assert!((weights[2] - 2.0).abs() < 1e-5 && weights[3] > 1.0 && weights[3] < 2.0, "{weights:?}");
    }

    #[test]
    fn faces_and_pixels_take_the_weight_of_what_is_there() {
        let model = squares();
        let importance = Importance::of(&model, &params(3.0)).expect("sound").expect("named");
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
        let views = crate::render::take_views(&sampler, &[camera], crate::render::Sampling::antialiased(64));
        let weights = &importance.of_pixels(&model, None, &[&views[0]])[0];
        let row = &weights[32 * 64..33 * 64];
        assert_eq!((row[0], row[26], row[38], row[63]), (1.0, 3.0, 1.0, 1.0));
    }
}
