//! Skeleton, weights and clips.
//!
//! Weights are cubic B-splines over the chain a vertex belongs to: four joints, smooth to the second derivative. Joints
//! are oriented along their bone (Z forward, Y up), so a turn about X lifts an arm and one about Y swings it.

use std::f64::consts::TAU;

use glam::{DMat4, DQuat, DVec3};
use libm::{atan2, cos, sin};

use crate::shape::{ARM_ROOT, ARMS, Mesh, Octopus, Part, Vertex, smoothstep};

const ARM_JOINTS: usize = 6;
const MANTLE_JOINTS: usize = 3;
const KEYS_PER_SECOND: f64 = 12.0;

/// Where the mantle's joints sit along the body, in shares of its length.
const MANTLE: [f64; MANTLE_JOINTS] = [0.52, 0.66, 0.82];
const HEAD: usize = 1;
const MANTLE_FIRST: usize = 2;
const EYE_FIRST: usize = MANTLE_FIRST + MANTLE_JOINTS;
const ARM_FIRST: usize = EYE_FIRST + 2;

pub(crate) struct Joint {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// Rest rotation and position in the world.
    rotation: DQuat,
    position: DVec3,
}

pub(crate) struct Influences {
    pub(crate) joints: [u8; 4],
    /// Sums to 65,535.
    pub(crate) weights: [u16; 4],
}

pub(crate) enum Values {
    Rotation(Vec<DQuat>),
    Translation(Vec<DVec3>),
}

pub(crate) struct Channel {
    pub(crate) joint: usize,
    pub(crate) values: Values,
}

pub(crate) struct Clip {
    pub(crate) name: &'static str,
    /// Seconds, shared by all channels.
    pub(crate) times: Vec<f64>,
    pub(crate) channels: Vec<Channel>,
}

pub(crate) struct Rig {
    pub(crate) joints: Vec<Joint>,
    pub(crate) clips: Vec<Clip>,
}

impl Rig {
    pub(crate) fn new(octopus: &Octopus) -> Self {
        let joints = skeleton(octopus);
        let clips = vec![walk(&joints), look_around(&joints)];
        Self { joints, clips }
    }

    /// A joint's rest translation and rotation relative to its parent.
    pub(crate) fn local(&self, joint: usize) -> (DVec3, DQuat) {
        local(&self.joints, joint)
    }

    pub(crate) fn inverse_bind(&self, joint: usize) -> DMat4 {
        DMat4::from_rotation_translation(self.joints[joint].rotation, self.joints[joint].position).inverse()
    }

    pub(crate) fn bind(&self, mesh: &Mesh) -> Vec<Influences> {
        mesh.vertices.iter().map(influences).collect()
    }
}

fn arm_joint(arm: usize, k: usize) -> usize {
    ARM_FIRST + arm * ARM_JOINTS + k
}

fn arm_joint_along(k: usize) -> f64 {
    ARM_ROOT + (0.92 - ARM_ROOT) * k as f64 / ARM_JOINTS as f64
}

fn skeleton(octopus: &Octopus) -> Vec<Joint> {
    let joint = |name: &str, parent, rotation, position| Joint { name: name.to_owned(), parent, rotation, position };
    let mut joints = vec![
        joint("root", None, DQuat::IDENTITY, DVec3::ZERO),
        joint("head", Some(0), DQuat::IDENTITY, octopus.body_centre(0.3)),
    ];
    for (k, along) in MANTLE.into_iter().enumerate() {
        let forward = octopus.body_centre(along + 0.02) - octopus.body_centre(along);
        joints.push(joint(&format!("mantle_{k}"), Some(HEAD + k), facing(forward), octopus.body_centre(along)));
    }
    for (side, name) in ["eye_right", "eye_left"].into_iter().enumerate() {
        let (centre, gaze) = octopus.eye(side);
        joints.push(joint(name, Some(HEAD), facing(gaze), centre));
    }
    for arm in 0..ARMS {
        for k in 0..ARM_JOINTS {
            let station = octopus.arm_station(arm, arm_joint_along(k));
            let parent = if k == 0 { HEAD } else { arm_joint(arm, k - 1) };
            let rotation = turn(DVec3::Y, station.heading) * turn(DVec3::X, -station.pitch);
            joints.push(joint(&format!("arm_{arm}_{k}"), Some(parent), rotation, station.position));
        }
    }
    joints
}

fn local(joints: &[Joint], index: usize) -> (DVec3, DQuat) {
    let joint = &joints[index];
    match joint.parent.map(|p| &joints[p]) {
        None => (joint.position, joint.rotation),
        Some(parent) => {
            let inverse = parent.rotation.conjugate();
            (inverse * (joint.position - parent.position), (inverse * joint.rotation).normalize())
        }
    }
}

/// The rotation whose Z looks along `forward` and whose X stays level.
fn facing(forward: DVec3) -> DQuat {
    let level = DVec3::new(forward.x, 0.0, forward.z).length();
    turn(DVec3::Y, atan2(forward.x, forward.z)) * turn(DVec3::X, -atan2(forward.y, level))
}

fn turn(axis: DVec3, angle: f64) -> DQuat {
    let v = axis * sin(angle * 0.5);
    DQuat::from_xyzw(v.x, v.y, v.z, cos(angle * 0.5))
}

fn influences(vertex: &Vertex) -> Influences {
    let mut weighted: Vec<(usize, f64)> = match vertex.part {
        Part::Eye(side) => vec![(EYE_FIRST + side, 1.0)],
        Part::Arm(arm) => {
            let x = (vertex.along - ARM_ROOT) / (0.92 - ARM_ROOT) * ARM_JOINTS as f64 + 0.5;
            spread(x, ARM_JOINTS + 1, |k| if k == 0 { HEAD } else { arm_joint(arm, k - 1) })
        }
        Part::Body => body_influences(vertex),
    };
    weighted.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut out = Influences { joints: [0; 4], weights: [0; 4] };
    for (slot, (joint, weight)) in weighted.into_iter().take(4).enumerate() {
        out.weights[slot] = (weight * 65_535.0 + 0.5) as u16;
        out.joints[slot] = if out.weights[slot] > 0 { joint as u8 } else { 0 };
    }
    // Rounding error goes to the heaviest joint.
    let rest: u32 = out.weights[1..].iter().map(|&w| u32::from(w)).sum();
    out.weights[0] = (65_535 - rest) as u16;
    out
}

/// The web follows the two nearest arms by half, the head and mantle their own chain.
fn body_influences(vertex: &Vertex) -> Vec<(usize, f64)> {
    let web = 0.5 * smoothstep(0.26, 0.14, vertex.along);
    if web > 0.0 {
        // Arms start half a step from +Z and go towards +X; `around` goes the other way from +X.
        let position = ((1.25 - vertex.around) * ARMS as f64 - 0.5).rem_euclid(ARMS as f64);
        let (arm, share) = (position.floor() as usize % ARMS, position.fract());
        let next = (arm + 1) % ARMS;
        return vec![(HEAD, 1.0 - web), (arm_joint(arm, 0), web * (1.0 - share)), (arm_joint(next, 0), web * share)];
    }
    let after = MANTLE.iter().filter(|&&m| m <= vertex.along).count();
    let knot = |k: usize| if k == 0 { 0.3 } else { MANTLE.get(k - 1).copied().unwrap_or(1.0) };
    let x = after as f64 + (vertex.along - knot(after)) / (knot(after + 1) - knot(after));
    spread(x, MANTLE_JOINTS + 1, |k| HEAD + k)
}

/// Uniform cubic B-spline weights at `x` over a chain of `count` joints whose influence is centred on 0, 1, 2..;
/// what falls off an end goes to the joint there.
fn spread(x: f64, count: usize, joint: impl Fn(usize) -> usize) -> Vec<(usize, f64)> {
    let x = x.clamp(0.0, (count - 1) as f64);
    let first = x.floor();
    let t = x - first;
    let basis = [
        (1.0 - t) * (1.0 - t) * (1.0 - t),
        4.0 - 6.0 * t * t + 3.0 * t * t * t,
        1.0 + 3.0 * t + 3.0 * t * t - 3.0 * t * t * t,
        t * t * t,
    ];
    let mut out: Vec<(usize, f64)> = Vec::with_capacity(4);
    for (k, b) in basis.into_iter().enumerate() {
        let joint = joint((first as i64 + k as i64 - 1).clamp(0, count as i64 - 1) as usize);
        match out.iter_mut().find(|(j, _)| *j == joint) {
            Some((_, weight)) => *weight += b / 6.0,
            None => out.push((joint, b / 6.0)),
        }
    }
    out
}

/// Collects a clip's channels; every motion is a turn on top of the rest pose.
struct ClipBuilder<'a> {
    joints: &'a [Joint],
    clip: Clip,
}

impl<'a> ClipBuilder<'a> {
    fn new(joints: &'a [Joint], name: &'static str, seconds: f64) -> Self {
        let keys = (seconds * KEYS_PER_SECOND) as usize;
        let times = (0..=keys).map(|k| seconds * k as f64 / keys as f64).collect();
        Self { joints, clip: Clip { name, times, channels: Vec::new() } }
    }

    /// Phase of each key in turns; the last equals the first, so that the clip loops.
    fn phases(&self) -> impl Iterator<Item = f64> + use<> {
        let keys = self.clip.times.len() - 1;
        (0..=keys).map(move |k| (k % keys) as f64 / keys as f64)
    }

    /// `motion`: turns of the clip to (about X, about Y) in radians, in the joint's own frame.
    fn rotate(&mut self, joint: usize, motion: impl Fn(f64) -> (f64, f64)) {
        let rest = local(self.joints, joint).1;
        let values = self
            .phases()
            .map(|t| {
                let (x, y) = motion(t);
                (rest * turn(DVec3::Y, y) * turn(DVec3::X, x)).normalize()
            })
            .collect();
        self.clip.channels.push(Channel { joint, values: Values::Rotation(values) });
    }

    fn translate(&mut self, joint: usize, offset: impl Fn(f64) -> DVec3) {
        let rest = local(self.joints, joint).0;
        let values = self.phases().map(|t| rest + offset(t)).collect();
        self.clip.channels.push(Channel { joint, values: Values::Translation(values) });
    }
}

/// A crawl in place: a wave runs out along each arm, neighbours a little over half a turn apart.
fn walk(joints: &[Joint]) -> Clip {
    let mut clip = ClipBuilder::new(joints, "walk", 2.0);
    clip.translate(HEAD, |t| DVec3::new(0.006 * sin(t * TAU), 0.006 + 0.006 * cos(2.0 * t * TAU), 0.0));
    clip.rotate(HEAD, |t| (0.05 * sin(2.0 * t * TAU), 0.05 * sin(t * TAU)));
    for k in 0..MANTLE_JOINTS {
        clip.rotate(MANTLE_FIRST + k, |t| {
            (0.07 * sin(2.0 * t * TAU - 0.9 * k as f64), 0.08 * sin(t * TAU - 0.7 * k as f64))
        });
    }
    for arm in 0..ARMS {
        let phase = 0.56 * arm as f64;
        for k in 0..ARM_JOINTS {
            let lag = 0.12 * k as f64;
            // The root joint only lifts; the others press down as much as they lift.
            let (lift, hold) = if k == 0 { (0.2, 0.24) } else { (0.17, 0.0) };
            clip.rotate(arm_joint(arm, k), |t| {
                let wave = (t + phase - lag) * TAU;
                (-hold - lift * sin(wave), 0.16 * cos(wave))
            });
        }
    }
    clip.clip
}

/// The head turns left and right, the eyes lead, two arms rise to feel about.
fn look_around(joints: &[Joint]) -> Clip {
    let mut clip = ClipBuilder::new(joints, "look_around", 4.0);
    // Held at each side: a sine flattened at its extremes.
    let look = |t: f64| {
        let s = sin(t * TAU);
        s * (1.5 - 0.5 * s * s)
    };
    clip.rotate(HEAD, |t| (0.06 * sin(2.0 * t * TAU), 0.34 * look(t - 0.03)));
    for eye in 0..2 {
        clip.rotate(EYE_FIRST + eye, |t| (0.18 * sin(2.0 * t * TAU), 0.42 * look(t)));
    }
    for k in 0..MANTLE_JOINTS {
        clip.rotate(MANTLE_FIRST + k, |t| (0.05 * sin(4.0 * t * TAU), -0.16 * look(t - 0.05 * (k + 1) as f64)));
    }
    for arm in 0..ARMS {
        let raised = if arm == 0 || arm == ARMS - 1 { 1.0 } else { 0.0 };
        for k in 0..ARM_JOINTS {
            let rise = raised * if k < 2 { 0.55 } else { 0.12 };
            let drift = if k == 0 { 0.0 } else { 0.1 };
            clip.rotate(arm_joint(arm, k), |t| {
                let up = 0.5 - 0.5 * cos(t * TAU);
                (-rise * up, drift * sin((t - 0.1 * k as f64 + 0.13 * arm as f64) * TAU))
            });
        }
    }
    clip.clip
}
