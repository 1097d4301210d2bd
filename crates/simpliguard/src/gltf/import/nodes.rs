//! The default scene's node tree in the rest pose.

use glam::{Mat4, Quat, Vec3};

use super::asset::Asset;
use super::schema::{ChannelTarget, Node, Root};
use crate::Error;

/// World matrices and parents of the default scene's nodes.
#[derive(Debug)]
pub(super) struct Tree {
    /// Indexed as `nodes`; identity outside the default scene.
    pub(super) world: Vec<Mat4>,
    /// The nodes of the default scene, ascending.
    pub(super) nodes: Vec<usize>,
    /// The same nodes, each after its parent.
    order: Vec<usize>,
    parent: Vec<Option<usize>>,
}

impl Tree {
    /// Walks the default scene.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a node is reached twice, through a cycle or two parents, or has a transform that is not
    /// finite; [`Error::Limit`] over the limits on nodes and depth.
    pub(super) fn of(asset: Asset<'_>, root: &Root<'_>) -> Result<Self, Error> {
        asset.within("the number of nodes", root.nodes.len(), asset.limits.nodes)?;
        let mut tree = Self {
            world: vec![Mat4::IDENTITY; root.nodes.len()],
            nodes: Vec::new(),
            order: Vec::new(),
            parent: vec![None; root.nodes.len()],
        };
        let mut reached = vec![false; root.nodes.len()];
        let mut pending: Vec<_> = scene_roots(asset, root)?.into_iter().map(|node| (node, Mat4::IDENTITY, 1)).collect();
        while let Some((index, parent_world, depth)) = pending.pop() {
            let node = asset.item(&root.nodes, index, "node")?;
            asset.within("the depth of the node tree", depth, asset.limits.depth)?;
            if std::mem::replace(&mut reached[index], true) {
                return Err(asset.invalid(format!(
                    "node {index} is reached twice from the default scene: the nodes form a cycle or have two parents"
                )));
            }
            let world = parent_world * local_matrix(node);
            if !world.is_finite() {
                return Err(asset.invalid(format!("node {index} has a transform that is not finite")));
            }
            tree.world[index] = world;
            tree.order.push(index);
            for &child in &node.children {
                asset.item(&root.nodes, child, "node")?;
                tree.parent[child] = Some(index);
                pending.push((child, world, depth + 1));
            }
        }
        tree.nodes.clone_from(&tree.order);
        tree.nodes.sort_unstable();
        Ok(tree)
    }

    /// World matrix of each node for other local matrices; identity outside the default scene.
    pub(super) fn world_with(&self, local: impl Fn(usize) -> Mat4) -> Vec<Mat4> {
        let mut world = vec![Mat4::IDENTITY; self.parent.len()];
        for &node in &self.order {
            let above = self.parent[node].map_or(Mat4::IDENTITY, |parent| world[parent]);
            world[node] = above * local(node);
        }
        world
    }

    /// The nodes of the default scene, each after its parent.
    pub(super) fn ordered(&self) -> impl Iterator<Item = usize> {
        self.order.iter().copied()
    }

    /// `node` and its ancestors, upwards.
    pub(super) fn lineage(&self, node: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(node), |&node| self.parent[node])
    }

    /// Per node, true if an animation moves it or one of its ancestors.
    pub(super) fn animated(&self, root: &Root<'_>) -> Vec<bool> {
        let mut targeted = vec![false; root.nodes.len()];
        for channel in root.animations.iter().flat_map(|animation| &animation.channels) {
            if let Some(slot) = moved_node(&channel.target).and_then(|node| targeted.get_mut(node)) {
                *slot = true;
            }
        }
        (0..root.nodes.len()).map(|node| self.lineage(node).any(|node| targeted[node])).collect()
    }
}

/// The node whose transform a channel drives.
fn moved_node(target: &ChannelTarget<'_>) -> Option<usize> {
    let moves = |path: &str| matches!(path, "translation" | "rotation" | "scale" | "matrix");
    if moves(target.path) {
        return target.node;
    }
    let pointer = target.extensions.pointer.as_ref()?.pointer;
    let (node, path) = pointer.strip_prefix("/nodes/")?.split_once('/')?;
    if moves(path) { node.parse().ok() } else { None }
}

/// Roots of the default scene: those of `scene`, else of the first scene, else every node without a parent.
fn scene_roots(asset: Asset<'_>, root: &Root<'_>) -> Result<Vec<usize>, Error> {
    if !root.scenes.is_empty() {
        return Ok(asset.item(&root.scenes, root.scene.unwrap_or(0), "scene")?.nodes.clone());
    }
    let mut is_child = vec![false; root.nodes.len()];
    for &child in root.nodes.iter().flat_map(|node| &node.children) {
        if let Some(slot) = is_child.get_mut(child) {
            *slot = true;
        }
    }
    Ok((0..root.nodes.len()).filter(|&node| !is_child[node]).collect())
}

/// A node's transform relative to its parent, in the rest pose.
pub(super) fn local_matrix(node: &Node<'_>) -> Mat4 {
    if let Some(matrix) = node.matrix {
        return Mat4::from_cols_array(&matrix);
    }
    trs(
        node.translation.unwrap_or_default().into(),
        node.rotation.map_or(Quat::IDENTITY, Quat::from_array),
        node.scale.map_or(Vec3::ONE, Vec3::from_array),
    )
}

/// The matrix of translation, rotation and scale. The quaternion may have any length.
pub(super) fn trs(translation: Vec3, rotation: Quat, scale: Vec3) -> Mat4 {
    let length = rotation.length();
    let unit = if length.is_finite() && length > 0.0 { rotation / length } else { Quat::IDENTITY };
    Mat4::from_scale_rotation_translation(scale, unit, translation)
}
