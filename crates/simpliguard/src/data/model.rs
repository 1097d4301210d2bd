//! A source model after import, and the levels made from it.

use bytes::Bytes;
use glam::{Mat4, Vec2, Vec3, Vec4};

use super::{Material, Texture};

/// A source model: one surface in world space, its materials and its skeleton.
#[derive(Clone, Debug)]
pub struct Model {
    /// The source's name, for messages.
    pub name: String,
    /// Every triangle of the default scene, instanced, in the rest pose.
    pub surface: Surface,
    /// Indexed by [`Surface::material`]; never empty if there are triangles.
    pub materials: Vec<Material>,
    /// Decoded images with their samplers, indexed by [`TextureRef::texture`].
    pub textures: Vec<Texture>,
    /// The bones the surface hangs on; `None` for a static model.
    pub rig: Option<Rig>,
    /// The source's own document, to be passed through by the export.
    pub document: Document,
    /// What the import left out, in words for the report: one line each.
    pub notes: Vec<String>,
}

impl Model {
    /// A model of that name with nothing in it.
    pub fn empty(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            surface: Surface::default(),
            materials: Vec::new(),
            textures: Vec::new(),
            rig: None,
            document: Document::default(),
            notes: Vec::new(),
        }
    }

    /// The material of triangle `t` of the surface.
    pub fn material_of(&self, t: u32) -> &Material {
        &self.materials[self.surface.material[t as usize] as usize]
    }
}

/// A triangle soup in world space: metres, right-handed, y up, counter-clockwise faces seen from outside.
///
/// All per-vertex arrays have the length of `positions`, except those said to be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Rest pose, world space.
    pub positions: Vec<Vec3>,
    /// Unit length; area-weighted face normals where the source has none.
    pub normals: Vec<Vec3>,
    /// MikkTSpace tangent and handedness in `w`; zero where the source has none. Empty if no vertex has one.
    pub tangents: Vec<Vec4>,
    /// `TEXCOORD_0` and `TEXCOORD_1`, untransformed, origin at the top left; zero where missing. The second is empty
    /// if no material uses it.
    pub uvs: [Vec<Vec2>; 2],
    /// `COLOR_0`, linear RGBA; one where missing. Empty if no vertex has one.
    pub colors: Vec<Vec4>,
    /// Red of `COLOR_1`, 0 to 1; zero where missing. Empty if no vertex has one.
    pub painted: Vec<f32>,
    /// Bones of each vertex; empty if [`Model::rig`] is `None`.
    pub influences: Vec<Influences>,
    /// Vertex indices; no degenerate triangle and no exact duplicate.
    pub triangles: Vec<[u32; 3]>,
    /// Material of each triangle.
    pub material: Vec<u32>,
    /// Its morph targets, if it has any that levels can take over.
    pub morphs: Option<Morphs>,
}

/// Morph targets that the weights of one node drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Morphs {
    /// Index of the node in the glTF's `nodes`.
    pub node: usize,
    /// In the node's order.
    pub targets: Vec<MorphTarget>,
}

/// One morph target.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MorphTarget {
    /// From the mesh's `extras.targetNames`; empty if unnamed.
    pub name: String,
    /// Its weight in the rest pose.
    pub weight: f32,
    /// How far vertices go at a weight of one, in the world at rest, in metres; ascending by vertex, without those that
    /// stay.
    pub moves: Vec<(u32, Vec3)>,
}

impl MorphTarget {
    /// How far a vertex goes.
    pub fn of(&self, vertex: u32) -> Vec3 {
        self.moves.binary_search_by_key(&vertex, |(v, _)| *v).map_or(Vec3::ZERO, |at| self.moves[at].1)
    }
}

/// Smallest [`Surface::extent`] that levels are made for, in metres: below it the squares of areas leave the range of
/// `f32`.
pub const SMALLEST_EXTENT: f32 = 1e-6;

impl Surface {
    /// Longest side of the bounding box of all faces with finite corners, in metres; 0 without such faces.
    pub fn extent(&self) -> f32 {
        let mut bounds: Option<(Vec3, Vec3)> = None;
        for triangle in &self.triangles {
            let corners = triangle.map(|vertex| self.positions[vertex as usize]);
            if corners.iter().all(|p| p.is_finite()) {
                for p in corners {
                    let (low, high) = bounds.unwrap_or((p, p));
                    bounds = Some((low.min(p), high.max(p)));
                }
            }
        }
        bounds.map_or(0.0, |(low, high)| (high - low).max_element())
    }
}

/// Up to four bones of one vertex. Weights fall, sum to one, and unused slots are zero in both arrays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Influences {
    /// Indices into [`Rig::bones`].
    pub joints: [u16; 4],
    /// Part of each bone.
    pub weights: [f32; 4],
}

impl Influences {
    /// Entirely on one bone.
    pub fn rigid(joint: u16) -> Self {
        Self { joints: [joint, 0, 0, 0], weights: [1.0, 0.0, 0.0, 0.0] }
    }
}

/// The bones of a model, over all its skins and all mesh nodes that an animation moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// A bone is a node together with an inverse bind matrix; at most 65,535.
    pub bones: Vec<Bone>,
    /// The source's only skin, if `bones` are exactly its joints in order: levels then reuse it unchanged.
    pub source_skin: Option<usize>,
    /// Frames of the source's clips, a few of each; made up if it has none.
    pub poses: Vec<Pose>,
}

/// The bones in one frame of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Index in the glTF's `animations`, and seconds in that clip; `None` for a pose that is made up.
    pub frame: Option<(usize, f32)>,
    /// From each bone's joint to the world.
    pub world: Vec<Mat4>,
}

/// One bone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bone {
    /// Index of the joint in the glTF's `nodes`.
    pub node: usize,
    /// From bind space to the joint.
    pub inverse_bind: Mat4,
    /// From the joint to the world in the rest pose of the node tree.
    pub rest_world: Mat4,
}

impl Rig {
    /// From bind space to the world in the rest pose, for a vertex with these influences: `sum w (rest_world inverse_bind)`.
    pub fn rest_matrix(&self, influences: &Influences) -> Mat4 {
        let mut m = Mat4::ZERO;
        for (&joint, &weight) in influences.joints.iter().zip(&influences.weights) {
            if weight > 0.0 {
                let bone = &self.bones[joint as usize];
                m += bone.rest_world * bone.inverse_bind * weight;
            }
        }
        m
    }
}

/// The source glTF itself: JSON, and every byte it refers to, read and checked.
#[derive(Clone, Debug, Default)]
pub struct Document {
    /// The JSON as it stands in the file.
    pub json: serde_json::Value,
    /// One entry per glTF buffer, at least `byteLength` long.
    pub buffers: Vec<Bytes>,
    /// One entry per glTF image: the encoded bytes and MIME type of those given by URI, `None` for those in a buffer view
    /// and for those that could not be read.
    pub images: Vec<Option<(Bytes, &'static str)>>,
    /// Nodes of the default scene that carry triangles: what the levels replace, ascending.
    pub mesh_nodes: Vec<usize>,
    /// World matrix of each node in the rest pose, indexed as `nodes`; identity for nodes outside the default scene.
    pub node_world: Vec<Mat4>,
}
