//! One level as glTF: mesh, material and textures.

use serde_json::{Value, json};

use super::builder::{BufferTarget, Builder, Component, Kind, number};
use super::fault::fault;
use super::material::push_material;
use super::skin::{Binding, check_influences};
use super::textures::{EncodedTextures, WrittenTextures};
use super::vertex_order;
use super::vertices::Vertices;
use crate::data::{AlphaMode, LayerMaterial, Level, LevelLayer, LevelMaterial, Model};
use crate::{Cancellation, Error};

/// Largest number of vertices with 16-bit indices; the index 65,535 itself is a primitive restart.
const MAX_SHORT_INDEXED: usize = 65_535;

/// A level ready to be appended to a document. Levels are prepared in parallel, and appended one after the other.
pub(super) struct EncodedLevel {
    layers: Vec<EncodedLayer>,
    /// Name and default weight of each morph target.
    targets: Vec<(String, f32)>,
    textures: EncodedTextures,
}

/// A layer of a level: one primitive.
struct EncodedLayer {
    vertices: Vertices,
    triangles: Vec<[u32; 3]>,
    material: EncodedMaterial,
}

enum EncodedMaterial {
    Own(LevelMaterial),
    /// Index in the document; `None` for the default material.
    Source(Option<usize>),
}

impl EncodedLevel {
    /// Orders vertices and triangles, transforms them to bind space if `binding` is a skin, and encodes the textures.
    pub(super) fn new(
        model: &Model,
        level: &Level,
        binding: Option<&Binding>,
        cancellation: &Cancellation,
    ) -> Result<Self, Error> {
        check(model, level)?;
        let mesh = &level.mesh;
        let skin = binding.filter(|_| !mesh.influences.is_empty());
        let mut vertices = skin.map_or_else(|| Vertices::in_world(mesh), |skin| skin.bind(mesh));
        let targets =
            model.surface.morphs.iter().flat_map(|morphs| &morphs.targets).filter(|_| !mesh.morphs.is_empty());
        let targets: Vec<(String, f32)> = targets.map(|target| (target.name.clone(), target.weight)).collect();
        vertices.subtract_morphs(targets.iter().map(|(_, weight)| *weight));
        vertices.round_handedness();
        let layers = level.layer_ranges().map(|(range, material)| {
            let (triangles, count) = (&mesh.triangles[range], mesh.positions.len());
            let alpha_mode = match material {
                LayerMaterial::Baked(material) => material.alpha_mode,
                LayerMaterial::Source(material) => model.materials[*material as usize].alpha_mode,
            };
            // What lies behind is blended first: the order of clear triangles stays.
            let (triangles, order) = match alpha_mode {
                AlphaMode::Blend => vertex_order::by_first_use(triangles.to_vec(), count),
                AlphaMode::Opaque | AlphaMode::Mask { .. } => vertex_order::optimized(triangles, count),
            };
            EncodedLayer::new(model, vertices.reordered(&order), triangles, material)
        });
        let layers = layers.collect();
        let baked = |layer: &LevelLayer| layer.material.baked().map(|material| material.alpha_mode);
        let has_alpha = level.layers.iter().filter_map(baked).any(|mode| mode != AlphaMode::Opaque);
        let textures = EncodedTextures::new(&model.name, &level.textures, has_alpha, cancellation)?;
        Ok(Self { layers, targets, textures })
    }

    /// True if it has morph targets.
    pub(super) fn has_morphs(&self) -> bool {
        !self.targets.is_empty()
    }

    /// True if joints move its vertices.
    pub(super) fn is_skinned(&self) -> bool {
        self.layers.iter().any(|layer| !layer.vertices.influences.is_empty())
    }

    /// Appends textures, materials and mesh; returns the mesh.
    pub(super) fn write(&self, out: &mut Builder, name: &str, sampler: usize) -> usize {
        let textures = self.textures.write(out, sampler);
        let write = |(i, layer): (usize, &EncodedLayer)| {
            let name = if i == 0 { name.to_owned() } else { format!("{name} clear") };
            layer.write(out, &name, &textures, self.has_morphs())
        };
        let primitives: Vec<Value> = self.layers.iter().enumerate().map(write).collect();
        let mut mesh = json!({ "name": name });
        if self.has_morphs() {
            mesh["weights"] = self.targets.iter().map(|(_, weight)| number(*weight)).collect();
            mesh["extras"] = json!({ "targetNames": self.targets.iter().map(|(name, _)| name).collect::<Vec<_>>() });
        }
        mesh["primitives"] = json!(primitives);
        out.push(Kind::Mesh, mesh)
    }
}

impl EncodedLayer {
    fn new(model: &Model, mut vertices: Vertices, triangles: Vec<[u32; 3]>, material: &LayerMaterial) -> Self {
        let material = match material {
            LayerMaterial::Baked(material) => {
                vertices.drop_kept();
                vertices.complete_tangents();
                EncodedMaterial::Own(material.clone())
            }
            LayerMaterial::Source(material) => {
                let material = &model.materials[*material as usize];
                vertices.drop_defaults(material);
                EncodedMaterial::Source(material.index)
            }
        };
        Self { vertices, triangles, material }
    }

    /// Appends the material and the accessors; returns the primitive.
    fn write(&self, out: &mut Builder, name: &str, textures: &WrittenTextures, morphs: bool) -> Value {
        let material = match &self.material {
            EncodedMaterial::Own(material) => Some(push_material(out, name, material, textures)),
            EncodedMaterial::Source(material) => *material,
        };
        let attributes = self.vertices.write(out);
        let indices = self.push_indices(out);
        let mut primitive = json!({ "attributes": attributes, "indices": indices });
        if let Some(material) = material {
            primitive["material"] = json!(material);
        }
        if morphs {
            primitive["targets"] = self.vertices.write_morphs(out);
        }
        primitive
    }

    fn push_indices(&self, out: &mut Builder) -> usize {
        if self.vertices.positions.len() <= MAX_SHORT_INDEXED {
            let short: Vec<u16> = self.triangles.iter().flatten().map(|&i| i as u16).collect();
            out.push_accessor(&short, Component::U16, "SCALAR", BufferTarget::Indices)
        } else {
            out.push_accessor(self.triangles.as_flattened(), Component::U32, "SCALAR", BufferTarget::Indices)
        }
    }
}

/// The node of a level.
pub(super) fn level_node(name: &str, mesh: usize, skin: Option<usize>) -> Value {
    let mut node = json!({ "name": name, "mesh": mesh });
    if let Some(skin) = skin {
        node["skin"] = json!(skin);
    }
    node
}

/// `Err` for a level that cannot be written.
fn check(model: &Model, level: &Level) -> Result<(), Error> {
    let bad = |found: String| fault(&model.name, format!("the level of {} faces is broken: {found}", level.budget));
    if level.mesh.triangles.is_empty() {
        return Err(bad("it has no triangles".into()));
    }
    level.mesh.check_arrays().map_err(bad)?;
    for layer in &level.layers {
        if let LayerMaterial::Source(material) = layer.material
            && material as usize >= model.materials.len()
        {
            return Err(bad(format!("it keeps material {material} of {}", model.materials.len())));
        }
    }
    check_influences(model, level)
}
