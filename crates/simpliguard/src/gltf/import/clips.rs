//! Poses of the bones: moments of the file's clips.
//!
//! It reads translation, rotation and scale of nodes, with all three interpolations. Rotations between two keys are
//! interpolated linearly and normalised. Morph weights and pointers into the document move no bone. A skeleton without
//! clips gets poses in which every joint is rotated a little at random.

use glam::{Mat4, Quat, Vec3, Vec4};

use super::accessor::Reader;
use super::nodes::{Tree, local_matrix, trs};
use super::schema::{Animation, Channel};
use crate::Error;
use crate::data::{Bone, Pose};
use crate::geometry::Random;

/// Number of poses from each clip, taken at the starts of as many equal intervals.
const FRAMES: usize = 8;
/// Largest number of matrices over all poses: 64 MB.
const MOST_MATRICES: usize = 1 << 20;
/// Rotation of a joint in a file without clips, as a fraction of a random rotation: 25 degrees on average.
const RANDOM_ROTATION: f32 = 0.2;

/// Poses from every clip, in the order of the clips: up to [`FRAMES`] of each, as many as [`MOST_MATRICES`] allows.
/// Clips that cannot be read are named in `notes`; the export keeps them all the same.
pub(super) fn poses(reader: Reader<'_>, tree: &Tree, bones: &[Bone], notes: &mut Vec<String>) -> Vec<Pose> {
    let clips = &reader.root.animations;
    if clips.is_empty() {
        return random_poses(reader, tree, bones);
    }
    let frames = (MOST_MATRICES / bones.len().max(1) / clips.len().max(1)).min(FRAMES);
    let mut bone_tree = BoneTree::of(reader, tree, bones);
    let mut has_rest_pose = false;
    let mut out = Vec::new();
    for (clip, animation) in clips.iter().enumerate().filter(|_| frames > 0) {
        // The import looks at the cancellation before it uses the poses.
        if reader.asset.cancellation.is_cancelled() {
            break;
        }
        let tracks = match tracks(reader, animation) {
            Ok(tracks) => tracks,
            Err(error) => {
                notes.push(format!("clip {clip} is left out of the poses that levels are fitted to: {error}"));
                continue;
            }
        };
        // All clips that move nothing have the same pose.
        if tracks.is_empty() && std::mem::replace(&mut has_rest_pose, true) {
            continue;
        }
        let last = tracks.iter().filter_map(|t| t.keys.last().copied()).fold(0.0, f32::max);
        let first = tracks.iter().filter_map(|t| t.keys.first().copied()).fold(last, f32::min);
        for frame in 0..frames {
            let seconds = first + (last - first) * frame as f32 / frames as f32;
            let world = bone_tree.world_at(reader, &tracks, seconds);
            if world.iter().all(Mat4::is_finite) {
                out.push(Pose { frame: Some((clip, seconds)), world });
            }
        }
    }
    out
}

/// Poses with every joint rotated at random.
fn random_poses(reader: Reader<'_>, tree: &Tree, bones: &[Bone]) -> Vec<Pose> {
    let mut random = Random::new(bones.len() as u64);
    let frames = (MOST_MATRICES / bones.len().max(1)).min(FRAMES);
    let mut pose = || {
        let mut rotations = vec![Mat4::IDENTITY; reader.root.nodes.len()];
        for bone in bones {
            let far = random.rotation();
            let far = if far.w < 0.0 { -far } else { far };
            let rotation = Vec4::from(Quat::IDENTITY).lerp(far.into(), RANDOM_ROTATION).normalize();
            rotations[bone.node] = Mat4::from_quat(Quat::from_vec4(rotation));
        }
        let world = tree.world_with(|node| local_matrix(&reader.root.nodes[node]) * rotations[node]);
        Pose { frame: None, world: bones.iter().map(|bone| world[bone.node]).collect() }
    };
    (0..frames).map(|_| pose()).filter(|pose| pose.world.iter().all(Mat4::is_finite)).collect()
}

/// The bones' nodes and their ancestors: all that a pose depends on. A file may have many other nodes.
struct BoneTree {
    /// Each after its parent.
    nodes: Vec<TreeNode>,
    /// For each node of the file, its index in `nodes`.
    index: Vec<Option<usize>>,
    /// The node of each bone, as an index in `nodes`; `None` outside the default scene.
    bones: Vec<Option<usize>>,
    /// Scratch: what a clip moves each of `nodes` to.
    moved: Vec<Option<Transform>>,
    /// Scratch: the world matrix of each of `nodes`.
    world: Vec<Mat4>,
}

struct TreeNode {
    /// Index in `BoneTree::nodes`.
    parent: Option<usize>,
    /// Relative to the parent, in the rest pose.
    local: Mat4,
}

impl BoneTree {
    fn of(reader: Reader<'_>, tree: &Tree, bones: &[Bone]) -> Self {
        let mut is_needed = vec![false; reader.root.nodes.len()];
        for bone in bones {
            for node in tree.lineage(bone.node) {
                if std::mem::replace(&mut is_needed[node], true) {
                    break;
                }
            }
        }
        let mut index = vec![None; is_needed.len()];
        let mut nodes = Vec::new();
        for node in tree.ordered().filter(|&node| is_needed[node]) {
            let parent = tree.lineage(node).nth(1).and_then(|parent| index[parent]);
            index[node] = Some(nodes.len());
            nodes.push(TreeNode { parent, local: local_matrix(&reader.root.nodes[node]) });
        }
        let bones = bones.iter().map(|bone| index[bone.node]).collect();
        let (moved, world) = (vec![None; nodes.len()], vec![Mat4::IDENTITY; nodes.len()]);
        Self { nodes, index, bones, moved, world }
    }

    /// The world matrix of each bone at a time of a clip.
    fn world_at(&mut self, reader: Reader<'_>, tracks: &[Track], seconds: f32) -> Vec<Mat4> {
        self.moved.fill(None);
        for track in tracks {
            let Some(index) = self.index[track.node] else { continue };
            let node = &reader.root.nodes[track.node];
            let transform = self.moved[index].get_or_insert_with(|| Transform {
                translation: node.translation.unwrap_or_default().into(),
                rotation: node.rotation.map_or(Quat::IDENTITY, Quat::from_array),
                scale: node.scale.map_or(Vec3::ONE, Vec3::from_array),
            });
            let value = track.at(seconds);
            match track.path {
                Path::Translation => transform.translation = value.truncate(),
                Path::Rotation => transform.rotation = Quat::from_vec4(value),
                Path::Scale => transform.scale = value.truncate(),
            }
        }
        for (i, node) in self.nodes.iter().enumerate() {
            let above = node.parent.map_or(Mat4::IDENTITY, |parent| self.world[parent]);
            let local = self.moved[i].map_or(node.local, |t| trs(t.translation, t.rotation, t.scale));
            self.world[i] = above * local;
        }
        self.bones.iter().map(|bone| bone.map_or(Mat4::IDENTITY, |index| self.world[index])).collect()
    }
}

#[derive(Clone, Copy)]
struct Transform {
    translation: Vec3,
    rotation: Quat,
    scale: Vec3,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Path {
    Translation,
    Rotation,
    Scale,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interpolation {
    Linear,
    Step,
    CubicSpline,
}

/// The values of one channel.
struct Track {
    node: usize,
    path: Path,
    interpolation: Interpolation,
    /// Seconds, ascending; at least one.
    keys: Vec<f32>,
    /// One value per key. A cubic spline has three: the tangent before, the value, the tangent after.
    values: Vec<Vec4>,
}

/// The channels of a clip that move a node and have keys.
fn tracks(reader: Reader<'_>, animation: &Animation<'_>) -> Result<Vec<Track>, Error> {
    reader
        .asset
        .fits("a clip", animation.channels.iter().map(|channel| memory_of(reader, animation, channel)).sum())?;
    let read = |channel: &Channel<'_>| Track::read(reader, animation, channel).transpose();
    animation.channels.iter().filter_map(read).collect()
}

/// Bytes of the keys of a channel, at most: a value has the size of a `Vec4`, and is there twice while it is read.
fn memory_of(reader: Reader<'_>, animation: &Animation<'_>, channel: &Channel<'_>) -> u64 {
    let sampler = channel.sampler.and_then(|sampler| animation.samplers.get(sampler));
    let count = |accessor: Option<usize>| accessor.and_then(|accessor| reader.count(accessor).ok()).unwrap_or(0) as u64;
    sampler.map_or(0, |sampler| 8 * count(sampler.input) + 32 * count(sampler.output))
}

impl Track {
    fn read(reader: Reader<'_>, animation: &Animation<'_>, channel: &Channel<'_>) -> Result<Option<Self>, Error> {
        let path = match channel.target.path {
            "translation" => Path::Translation,
            "rotation" => Path::Rotation,
            "scale" => Path::Scale,
            _ => return Ok(None),
        };
        let Some(node) = channel.target.node.filter(|&node| node < reader.root.nodes.len()) else { return Ok(None) };
        let Some(sampler) = channel.sampler else { return Ok(None) };
        let sampler = reader.asset.item(&animation.samplers, sampler, "animation sampler")?;
        let (Some(input), Some(output)) = (sampler.input, sampler.output) else { return Ok(None) };
        let interpolation = match sampler.interpolation {
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::CubicSpline,
            _ => Interpolation::Linear,
        };
        let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let count = reader.count(input)?.min(reader.count(output)? / per_key) as u32;
        let keys: Vec<f32> = reader.floats::<1>(input, 0..count)?.into_iter().map(|[seconds]| seconds).collect();
        let values = 0..count * per_key as u32;
        let values = match path {
            Path::Rotation => reader.floats::<4>(output, values)?.into_iter().map(Vec4::from).collect(),
            _ => reader.floats::<3>(output, values)?.into_iter().map(|v| Vec3::from(v).extend(0.0)).collect(),
        };
        let is_sound = count > 0 && keys.iter().all(|k| k.is_finite()) && keys.is_sorted();
        Ok(is_sound.then_some(Self { node, path, interpolation, keys, values }))
    }

    /// The value at a time: the first value before all keys, the last value after them.
    fn at(&self, seconds: f32) -> Vec4 {
        let next = self.keys.partition_point(|&key| key <= seconds);
        let (a, b) = (next.saturating_sub(1), next.min(self.keys.len() - 1));
        let span = self.keys[b] - self.keys[a];
        let t = if span > 0.0 { (seconds - self.keys[a]) / span } else { 0.0 };
        match self.interpolation {
            Interpolation::Step => self.values[a],
            Interpolation::Linear => {
                let (from, to) = (self.values[a], self.values[b]);
                let to = if self.path == Path::Rotation && from.dot(to) < 0.0 { -to } else { to };
                from.lerp(to, t)
            }
            Interpolation::CubicSpline => {
                let (t2, t3) = (t * t, t * t * t);
                self.values[3 * a + 1] * (2.0 * t3 - 3.0 * t2 + 1.0)
                    + self.values[3 * a + 2] * (span * (t3 - 2.0 * t2 + t))
                    + self.values[3 * b + 1] * (3.0 * t2 - 2.0 * t3)
                    + self.values[3 * b] * (span * (t3 - t2))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(interpolation: Interpolation, values: &[f32]) -> Track {
        let values = values.iter().map(|&v| Vec4::splat(v)).collect();
        Track { node: 0, path: Path::Scale, interpolation, keys: vec![1.0, 3.0], values }
    }

    #[test]
    fn times_between_keys_are_interpolated_and_others_clamped() {
        let linear = track(Interpolation::Linear, &[2.0, 6.0]);
        assert_eq!([0.0, 1.0, 1.5, 3.0, 9.0].map(|t| linear.at(t).x), [2.0, 2.0, 3.0, 6.0, 6.0]);
        let step = track(Interpolation::Step, &[2.0, 6.0]);
        assert_eq!([0.0, 2.9, 3.0].map(|t| step.at(t).x), [2.0, 2.0, 6.0]);
    }

    #[test]
    fn a_spline_goes_through_its_values_by_its_tangents() {
        // Value t^2: slopes 2 and 6 at the keys.
        let spline = track(Interpolation::CubicSpline, &[0.0, 1.0, 2.0, 6.0, 9.0, 0.0]);
        assert_eq!([1.0, 2.0, 3.0].map(|t| spline.at(t).x), [1.0, 4.0, 9.0]);
    }

    #[test]
    fn rotations_go_the_short_way() {
        let values = vec![Vec4::W, Vec4::new(0.0, 0.0, -0.6, -0.8)];
        let track = Track { path: Path::Rotation, values, ..track(Interpolation::Linear, &[0.0; 2]) };
        assert_eq!(track.at(2.0), Vec4::new(0.0, 0.0, 0.3, 0.9));
    }
}
