//! The rig of a file: bones over all skins and all mesh nodes that move as a whole.

use std::collections::BTreeMap;

use glam::Mat4;

use super::accessor::Reader;
use super::clips;
use super::influences::has_joints;
use super::nodes::Tree;
use super::primitive::has_triangles;
use crate::Error;
use crate::data::{Bone, Rig};

/// The rig of a file, and the bones of the file's skins and nodes.
#[derive(Debug, Default)]
pub(super) struct SourceSkeleton {
    pub(super) rig: Option<Rig>,
    /// For each skin, the bone of each of its joints; empty for unused skins.
    pub(super) skin_bones: Vec<Vec<u16>>,
    /// The bone of each node that carries unskinned triangles.
    pub(super) node_bones: BTreeMap<usize, u16>,
    /// Notes for the report.
    pub(super) notes: Vec<String>,
}

/// The skins that deform triangles of the default scene, and the nodes that move triangles as a whole. Both ascending.
#[derive(Debug, Default, PartialEq)]
struct BoneSources {
    skins: Vec<usize>,
    rigid: Vec<usize>,
}

impl SourceSkeleton {
    /// Builds the rig for the nodes in `mesh_nodes`.
    pub(super) fn of(reader: Reader<'_>, tree: &Tree, mesh_nodes: &[usize]) -> Result<Self, Error> {
        let sources = BoneSources::of(reader, mesh_nodes)?;
        let animated = tree.animated(reader.root);
        let mut out = Self { skin_bones: vec![Vec::new(); reader.root.skins.len()], ..Self::default() };
        if sources.skins.is_empty() && !sources.rigid.iter().any(|&node| animated[node]) {
            return Ok(out);
        }
        let mut bones = Vec::new();
        let mut source_skin = None;
        if let ([skin], []) = (sources.skins.as_slice(), sources.rigid.as_slice()) {
            bones = joints(reader, tree, *skin)?;
            out.skin_bones[*skin] = (0..bones.len()).map(|bone| bone as u16).collect();
            source_skin = Some(*skin);
        } else {
            let mut known = BTreeMap::new();
            let mut bone_index = |bone: Bone| {
                *known.entry((bone.node, bits(&bone.inverse_bind))).or_insert_with(|| {
                    bones.push(bone);
                    bones.len() - 1
                }) as u16
            };
            for skin in sources.skins {
                out.skin_bones[skin] = joints(reader, tree, skin)?.into_iter().map(&mut bone_index).collect();
            }
            for node in sources.rigid {
                out.node_bones.insert(node, bone_index(rigid_bone(tree, node)));
            }
        }
        reader.asset.within("the number of bones", bones.len(), u64::from(u16::MAX))?;
        let poses = clips::poses(reader, tree, &bones, &mut out.notes);
        out.rig = Some(Rig { bones, source_skin, poses });
        Ok(out)
    }
}

impl BoneSources {
    fn of(reader: Reader<'_>, mesh_nodes: &[usize]) -> Result<Self, Error> {
        let mut out = Self::default();
        for &index in mesh_nodes {
            let node = &reader.root.nodes[index];
            let Some(mesh) = node.mesh else { continue };
            let primitives = &reader.asset.item(&reader.root.meshes, mesh, "mesh")?.primitives;
            for primitive in primitives.iter().filter(|primitive| has_triangles(primitive)) {
                match node.skin {
                    Some(skin) if has_joints(primitive) => out.skins.push(skin),
                    _ => out.rigid.push(index),
                }
            }
        }
        for list in [&mut out.skins, &mut out.rigid] {
            list.sort_unstable();
            list.dedup();
        }
        Ok(out)
    }
}

/// The joints of a skin as bones, in the skin's order.
fn joints(reader: Reader<'_>, tree: &Tree, index: usize) -> Result<Vec<Bone>, Error> {
    let asset = reader.asset;
    let skin = asset.item(&reader.root.skins, index, "skin")?;
    asset.within(&format!("the number of joints of skin {index}"), skin.joints.len(), u64::from(u16::MAX))?;
    if skin.joints.is_empty() {
        return Err(asset.invalid(format!("skin {index} has no joints")));
    }
    let matrices: Vec<Mat4> = match skin.inverse_bind_matrices {
        Some(accessor) => {
            reader.floats::<16>(accessor, 0..skin.joints.len() as u32)?.iter().map(Mat4::from_cols_array).collect()
        }
        None => vec![Mat4::IDENTITY; skin.joints.len()],
    };
    if let Some(joint) = matrices.iter().position(|matrix| !matrix.is_finite()) {
        return Err(asset.invalid(format!("the inverse bind matrix of joint {joint} of skin {index} is not finite")));
    }
    let bone = |(&node, &inverse_bind): (&usize, &Mat4)| {
        let rest_world = *asset.item(&tree.world, node, "node")?;
        Ok(Bone { node, inverse_bind, rest_world })
    };
    skin.joints.iter().zip(&matrices).map(bone).collect()
}

/// The bone of a node that moves as a whole: the node itself, or its nearest ancestor with an invertible matrix if its
/// own scale is zero along an axis.
fn rigid_bone(tree: &Tree, node: usize) -> Bone {
    let invertible = |node: &usize| tree.world[*node].determinant() != 0.0 && tree.world[*node].inverse().is_finite();
    match tree.lineage(node).find(invertible) {
        Some(node) => Bone { node, inverse_bind: tree.world[node].inverse(), rest_world: tree.world[node] },
        None => Bone { node, inverse_bind: Mat4::IDENTITY, rest_world: tree.world[node] },
    }
}

fn bits(matrix: &Mat4) -> [u32; 16] {
    matrix.to_cols_array().map(f32::to_bits)
}
