//! Levels by quadric error alone, as the paper's QEM: the welded mesh collapses by the positions of its vertices.
//!
//! The collapse knows no texture. Each face takes the material of the source's face nearest to its centre, and each of its
//! corners the attributes of the nearest point of that material. So textures stay, and are distorted where a face
//! crosses a border of the source's charts.

use glam::{Vec2, Vec3};
use simpliguard::data::{Model, Surface, TriMesh};
use simpliguard::geometry::{Bvh, barycentric};
use simpliguard::simplify::{collapse, manifold};

/// Corners look for their point from a little inside their face, as a fraction of the way to its centre: those on a border of
/// the source's charts find the side that the face lies on.
const INWARDS: f32 = 0.02;

/// The source, ready to be collapsed.
pub(crate) struct Qem<'a> {
    source: &'a Model,
    welded: TriMesh,
    bvh: Bvh,
}

/// A point of the source: its triangle, and its place on it.
type Place = (u32, [f32; 3]);

impl<'a> Qem<'a> {
    pub(crate) fn new(source: &'a Model) -> Self {
        let Surface { positions, triangles, .. } = &source.surface;
        let welded = manifold(&TriMesh { positions: positions.clone(), triangles: triangles.clone() });
        Self { source, welded, bvh: Bvh::new(positions, triangles) }
    }

    /// The source with at most `budget` triangles.
    pub(crate) fn collapse(&self, budget: usize) -> Model {
        let mesh = collapse(&self.welded, budget);
        let mut places = Vec::with_capacity(3 * mesh.triangles.len());
        let mut material = Vec::with_capacity(mesh.triangles.len());
        for corners in mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])) {
            let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
            let own = self.nearest(centre, |_| true).map_or(0, |(t, _)| self.source.surface.material[t as usize]);
            let is_own = |t: u32| self.source.surface.material[t as usize] == own;
            places.extend(corners.map(|p| self.nearest(p.lerp(centre, INWARDS), is_own).unwrap_or_default()));
            material.push(own);
        }
        let surface = Surface {
            positions: mesh.triangles.as_flattened().iter().map(|&v| mesh.positions[v as usize]).collect(),
            triangles: (0..mesh.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            material,
            ..self.attributes(&places)
        };
        self.source.with_surface(surface, self.source.materials.clone())
    }

    /// The nearest point of the source's accepted triangles.
    fn nearest(&self, point: Vec3, accept: impl Fn(u32) -> bool) -> Option<Place> {
        let hit = self.bvh.closest_where(point, f32::INFINITY, accept)?;
        let surface = &self.source.surface;
        let corners = surface.triangles[hit.triangle as usize].map(|v| surface.positions[v as usize]);
        Some((hit.triangle, barycentric(hit.point, corners)))
    }

    /// The attributes of the source at these places; vertices without positions.
    fn attributes(&self, places: &[Place]) -> Surface {
        let Surface { normals, tangents, uvs, colors, .. } = &self.source.surface;
        let upright = |normal: Vec3| normal.normalize_or(Vec3::Y);
        let tangents = self.mixed(tangents, places).into_iter();
        Surface {
            normals: self.mixed(normals, places).into_iter().map(upright).collect(),
            tangents: tangents.map(|t| t.truncate().normalize_or(Vec3::X).extend(t.w.signum())).collect(),
            uvs: uvs.each_ref().map(|uvs| self.mixed::<Vec2>(uvs, places)),
            colors: self.mixed(colors, places),
            ..Surface::default()
        }
    }

    /// Values between those of the source's vertices; none if it has none.
    fn mixed<T>(&self, all: &[T], places: &[Place]) -> Vec<T>
    where
        T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        if all.is_empty() {
            return Vec::new();
        }
        let at = |(t, weights): &Place| {
            let [a, b, c] = self.source.surface.triangles[*t as usize].map(|v| all[v as usize]);
            a * weights[0] + b * weights[1] + c * weights[2]
        };
        places.iter().map(at).collect()
    }
}
