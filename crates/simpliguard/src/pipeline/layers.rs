//! The layers of a source: the solid surface, clear surfaces over it, and lattices. Each is made, textured and fitted on its
//! own.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::data::{AlphaMode, Material, Model};
use crate::render::{Opacity, SurfaceSampler, alpha_range};
use crate::simplify::{Lattice, find_lattices};

/// Largest alpha of a triangle that shows nothing.
const INVISIBLE: f32 = 3.0 / 255.0;
/// Least alpha of a triangle that hides what is behind.
const HIDING: f32 = 0.98;
/// The threshold for a cut-out whose material has none, and for those of levels.
pub(super) const CUTOFF: f32 = 0.5;
/// Fewest triangles that lattices leave to the solid layer.
const FEWEST_SOLID: usize = 100;

/// What a layer beside the solid one consists of.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum LayerKind {
    /// Flat things of many bars; with the lattice of each triangle.
    Lattices(Vec<u32>),
    /// Blended triangles, or triangles that transmit light.
    Clear,
}

/// A source, divided by what shows through its surfaces.
pub(super) struct SourceLayers<'a> {
    /// What hides what is behind it: opaque triangles, cut-outs, and glass with nothing but glass in the file.
    /// If there is none of this, the source as it is.
    pub(super) solid: Cow<'a, Model>,
    /// False if the whole source is clear.
    pub(super) has_solid: bool,
    /// The other layers: a model of each that is not empty.
    pub(super) extra: Vec<(LayerKind, Model)>,
}

impl<'a> SourceLayers<'a> {
    /// Divides a source; `lattices` have a layer of their own. Blended materials whose alpha is low or high nearly everywhere
    /// are cut-outs, and those of full alpha are opaque. Blended triangles that show nothing are left out.
    pub(super) fn divide(model: &'a Model, lattices: &[Lattice]) -> Self {
        let whole = || Self { solid: Cow::Borrowed(model), has_solid: true, extra: Vec::new() };
        if lattices.is_empty() && !may_be_clear(model) {
            return whole();
        }
        let mut division = Division::of(model);
        let lattice = division.divide_lattices(lattices);
        let [solid, blended, transmitting] =
            [Layer::Solid, Layer::Blended, Layer::Transmitting].map(|layer| division.triangles(layer));
        let (solid, transmitting) = if solid.is_some() { (solid, transmitting) } else { (transmitting, None) };
        let lattices = division.triangles(Layer::Lattice).map(|triangles| {
            let kind = LayerKind::Lattices(triangles.iter().map(|t| lattice[*t as usize]).collect());
            (kind, division.model(&triangles))
        });
        let clear = [blended, transmitting].into_iter().flatten();
        let clear = clear.map(|triangles| (LayerKind::Clear, division.model(&triangles)));
        let extra: Vec<_> = lattices.into_iter().chain(clear).collect();
        match solid {
            Some(solid) => Self { solid: Cow::Owned(division.model(&solid)), has_solid: true, extra },
            None if extra.is_empty() => whole(),
            None => Self { has_solid: false, extra, ..whole() },
        }
    }
}

/// The lattices of a source, at most `most`.
pub(super) fn lattices(model: &Model, most: usize) -> Vec<Lattice> {
    Division::of(model).lattices(most)
}

/// A material lets light through, or seems to.
fn may_be_clear(model: &Model) -> bool {
    model.materials.iter().any(|m| m.alpha_mode == AlphaMode::Blend || m.transmission.is_some())
}

/// The layer of a triangle.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layer {
    Solid,
    Blended,
    Transmitting,
    Lattice,
    Invisible,
}

/// The layer of each triangle of a source, and its material after the alpha modes are settled.
struct Division<'a> {
    source: &'a Model,
    layer: Vec<Layer>,
    material: Vec<u32>,
    materials: Vec<Material>,
}

impl<'a> Division<'a> {
    fn of(source: &'a Model) -> Self {
        let material = source.surface.material.clone();
        let layer = vec![Layer::Solid; material.len()];
        let mut out = Self { source, layer, material, materials: source.materials.clone() };
        if !may_be_clear(source) {
            return out;
        }
        let sampler = SurfaceSampler::new(source);
        let mut triangles = vec![Vec::new(); source.materials.len()];
        out.material.iter().zip(0..).for_each(|(&m, t)| triangles[m as usize].push(t));
        for (m, triangles) in triangles.iter().enumerate() {
            if source.materials[m].alpha_mode == AlphaMode::Blend {
                match Opacity::of(&sampler, triangles) {
                    Opacity::Opaque => out.materials[m].alpha_mode = AlphaMode::Opaque,
                    Opacity::CutOut => out.materials[m].alpha_mode = AlphaMode::Mask { cutoff: CUTOFF },
                    Opacity::Clear => out.divide_blended(&sampler, m, triangles),
                }
            }
            if out.materials[m].alpha_mode != AlphaMode::Blend && out.materials[m].transmission.is_some() {
                triangles.iter().for_each(|&t| out.layer[t as usize] = Layer::Transmitting);
            }
        }
        out
    }

    /// Finds the layers of the triangles of a blended material. Those of full alpha get an opaque copy of it.
    fn divide_blended(&mut self, sampler: &SurfaceSampler<'_>, m: usize, triangles: &[u32]) {
        let ranges: Vec<[f32; 3]> = triangles.par_iter().map(|&t| alpha_range(sampler, t)).collect();
        let opaque = Material { alpha_mode: AlphaMode::Opaque, transmission: None, ..self.materials[m].clone() };
        let opaque_index = self.materials.len() as u32;
        for (&t, [low, _, high]) in triangles.iter().zip(ranges) {
            self.layer[t as usize] = match (low >= HIDING, high <= INVISIBLE) {
                (true, _) => {
                    self.material[t as usize] = opaque_index;
                    Layer::Solid
                }
                (_, true) => Layer::Invisible,
                _ => Layer::Blended,
            };
        }
        self.materials.push(opaque);
    }

    /// The lattices of the solid layer, at most `most`; none if little would be left of it without them.
    fn lattices(&self, most: usize) -> Vec<Lattice> {
        let is_opaque = |t: u32| {
            let material = &self.materials[self.material[t as usize] as usize];
            self.layer[t as usize] == Layer::Solid && material.alpha_mode == AlphaMode::Opaque
        };
        let lattices = find_lattices(&self.source.surface, &is_opaque, most);
        let solid = self.layer.iter().filter(|layer| **layer == Layer::Solid).count();
        let rest = solid - lattices.iter().map(|lattice| lattice.triangles.len()).sum::<usize>();
        if rest < FEWEST_SOLID { Vec::new() } else { lattices }
    }

    /// Moves lattices of the solid layer to their own. Returns the lattice of each triangle.
    fn divide_lattices(&mut self, lattices: &[Lattice]) -> Vec<u32> {
        let mut lattice = vec![u32::MAX; self.layer.len()];
        for (Lattice { triangles, .. }, i) in lattices.iter().zip(0..) {
            triangles.iter().for_each(|&t| (self.layer[t as usize], lattice[t as usize]) = (Layer::Lattice, i));
        }
        lattice
    }

    /// The triangles of a layer, if it has any.
    fn triangles(&self, layer: Layer) -> Option<Vec<u32>> {
        let triangles: Vec<u32> = self.layer.iter().zip(0..).filter(|(of, _)| **of == layer).map(|(_, t)| t).collect();
        (!triangles.is_empty()).then_some(triangles)
    }

    /// The source with only these triangles.
    fn model(&self, triangles: &[u32]) -> Model {
        let mut surface = self.source.surface.subset(triangles);
        surface.material = triangles.iter().map(|&t| self.material[t as usize]).collect();
        self.source.with_surface(surface, self.materials.clone())
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, Vec4};

    use super::*;
    use crate::data::{Surface, Transmission};

    fn paint(alpha: f32, alpha_mode: AlphaMode) -> Material {
        Material { base_color: Vec4::new(1.0, 1.0, 1.0, alpha), alpha_mode, ..Material::default() }
    }

    fn glass() -> Material {
        let transmission = Transmission {
            factor: 1.0,
            ior: 1.5,
            thickness: 0.0,
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        };
        Material { transmission: Some(transmission), ..Material::default() }
    }

    /// A triangle of each material.
    fn model(materials: Vec<Material>) -> Model {
        let count = materials.len() as u32;
        let corner = |i: u32| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * i as f32);
        let surface = Surface {
            positions: (0..count).flat_map(corner).collect(),
            normals: vec![Vec3::Z; 3 * count as usize],
            triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            material: (0..count).collect(),
            ..Surface::default()
        };
        Model { surface, materials, ..Model::empty("layers") }
    }

    /// The distances along z of the triangles in the solid and in each clear layer.
    fn layers(materials: Vec<Material>) -> (bool, Vec<f32>, Vec<Vec<f32>>) {
        let model = model(materials);
        let layers = SourceLayers::divide(&model, &[]);
        let depths = |model: &Model| {
            let surface = &model.surface;
            surface.triangles.iter().map(|t| surface.positions[t[0] as usize].z).collect::<Vec<f32>>()
        };
        (layers.has_solid, depths(&layers.solid), layers.extra.iter().map(|(_, model)| depths(model)).collect())
    }

    #[test]
    fn each_surface_goes_to_its_layer() {
        let [opaque, clear] = [paint(1.0, AlphaMode::Opaque), paint(0.4, AlphaMode::Blend)];
        let [full, nothing] = [paint(1.0, AlphaMode::Blend), paint(0.005, AlphaMode::Blend)];
        let (has_solid, solid, clear) = layers(vec![opaque, clear, full, nothing, glass()]);
        assert!(has_solid);
        assert_eq!(solid, [0.0, 2.0]);
        assert_eq!(clear, [vec![1.0], vec![4.0]]);
    }

    #[test]
    fn a_source_that_is_clear_as_a_whole_has_no_solid_layer() {
        let (has_solid, solid, clear) = layers(vec![paint(0.4, AlphaMode::Blend), paint(0.2, AlphaMode::Blend)]);
        assert_eq!((has_solid, solid, clear), (false, vec![0.0, 1.0], vec![vec![0.0, 1.0]]));
    }

    #[test]
    fn a_source_of_transmitting_glass_alone_is_made_as_a_solid_one() {
        assert_eq!(layers(vec![glass()]), (true, vec![0.0], Vec::new()));
    }

    #[test]
    fn an_opaque_source_is_not_copied() {
        let model = model(vec![paint(1.0, AlphaMode::Opaque)]);
        assert!(matches!(SourceLayers::divide(&model, &[]).solid, Cow::Borrowed(_)));
    }
}
