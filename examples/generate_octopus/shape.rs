//! The octopus' rest pose as swept surfaces, in metres, Y up, facing +Z.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use libm::{cos, pow, sin, sqrt};

pub(crate) const ARMS: usize = 8;

/// Stations of the body from the mouth over the arms' web and the head to the tip of the mantle:
/// height, depth, radius, backward tilt of the cross-section in radians.
const BODY: [[f64; 4]; 14] = [
    [0.052, 0.000, 0.000, 0.00],
    [0.040, 0.000, 0.052, 0.00],
    [0.047, 0.000, 0.098, 0.00],
    [0.076, 0.004, 0.078, 0.00],
    [0.108, 0.010, 0.064, 0.00],
    [0.140, 0.014, 0.062, 0.05],
    [0.172, 0.010, 0.066, 0.20],
    [0.205, -0.008, 0.066, 0.50],
    [0.240, -0.042, 0.084, 0.72],
    [0.282, -0.085, 0.108, 0.80],
    [0.322, -0.126, 0.118, 0.80],
    [0.362, -0.168, 0.106, 0.85],
    [0.394, -0.204, 0.072, 0.90],
    [0.408, -0.222, 0.000, 0.90],
];
/// The station (of [`BODY`]) in front of which the eyes sit.
const EYE_STATION: f64 = 6.3;
pub(crate) const EYE_RADIUS: f64 = 0.029;

/// Angle of an arm's centre line above the horizon at equal steps along the arm, radians.
const ARM_PITCH: [f64; 9] = [-0.15, -0.62, -0.58, -0.12, 0.0, 0.05, 0.25, 1.2, 3.4];
const ARM_STEPS: usize = 512;
/// Share of the arm, from its root, that is hidden in the body.
pub(crate) const ARM_ROOT: f64 = 0.1;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Part {
    Body,
    Arm(usize),
    Eye(usize),
}

impl Part {
    pub(crate) fn all() -> impl Iterator<Item = Part> {
        [Part::Body].into_iter().chain((0..ARMS).map(Part::Arm)).chain((0..2).map(Part::Eye))
    }

    /// Quads along and around.
    fn quads(self) -> (usize, usize) {
        match self {
            Part::Body => (76, 96),
            Part::Arm(_) => (80, 20),
            Part::Eye(_) => (16, 24),
        }
    }
}

/// A point of an arm's centre line with its frame: heading (0 = +Z, towards +X) and pitch in radians, radius in metres.
#[derive(Clone, Copy)]
pub(crate) struct Station {
    pub(crate) position: DVec3,
    pub(crate) heading: f64,
    pub(crate) pitch: f64,
    radius: f64,
}

pub(crate) struct Octopus {
    arms: Vec<Vec<Station>>,
    eyes: [(DVec3, DVec3); 2],
}

#[derive(Clone, Copy)]
pub(crate) struct Vertex {
    pub(crate) part: Part,
    pub(crate) along: f64,
    pub(crate) around: f64,
    pub(crate) position: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) uv: DVec2,
}

pub(crate) struct Mesh {
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) triangles: Vec<[u16; 3]>,
}

impl Octopus {
    pub(crate) fn new() -> Self {
        let eyes = [-1.0, 1.0].map(|side| {
            let angle = PI / 2.0 - side * 0.82;
            let s = EYE_STATION / (BODY.len() - 1) as f64;
            let axis = body_axis(s);
            let outward = body_direction(angle, axis.tilt);
            (axis.centre + outward * axis.radius, (outward + DVec3::Y * 0.15).normalize())
        });
        Self { arms: (0..ARMS).map(arm).collect(), eyes }
    }

    /// Centre of an eye and the direction it looks in.
    pub(crate) fn eye(&self, side: usize) -> (DVec3, DVec3) {
        self.eyes[side]
    }

    pub(crate) fn arm_station(&self, arm: usize, along: f64) -> Station {
        let x = along.clamp(0.0, 1.0) * ARM_STEPS as f64;
        let i = (x as usize).min(ARM_STEPS - 1);
        let (a, b, t) = (self.arms[arm][i], self.arms[arm][i + 1], x - i as f64);
        Station {
            position: a.position.lerp(b.position, t),
            heading: mix(a.heading, b.heading, t),
            pitch: mix(a.pitch, b.pitch, t),
            radius: mix(a.radius, b.radius, t),
        }
    }

    /// Centre line of the body.
    pub(crate) fn body_centre(&self, along: f64) -> DVec3 {
        body_axis(along).centre
    }

    pub(crate) fn point(&self, part: Part, along: f64, around: f64) -> DVec3 {
        match part {
            Part::Body => self.body_point(along, around),
            Part::Arm(arm) => self.arm_point(arm, along, around),
            Part::Eye(side) => self.eye_point(side, along, around),
        }
    }

    fn body_point(&self, along: f64, around: f64) -> DVec3 {
        let axis = body_axis(along);
        let angle = around * TAU;
        let station = along * (BODY.len() - 1) as f64;
        let web = 1.0 - 0.16 * bump((station - 2.0) / 2.4) * cos(ARMS as f64 * angle);
        let outward = body_direction(angle, axis.tilt);
        let point = axis.centre + outward * axis.radius * web;
        let lids: f64 = self.eyes.iter().map(|(eye, _)| bump(point.distance(*eye) / 0.055)).sum();
        let warts = bump((station - 10.0) / 4.0) * (noise(point * 38.0) - 0.5);
        point + outward * (0.017 * lids + 0.007 * warts)
    }

    fn arm_point(&self, arm: usize, along: f64, around: f64) -> DVec3 {
        let station = self.arm_station(arm, along);
        let (side, up, _) = frame(station.heading, station.pitch);
        let (x, y) = (cos(around * TAU), sin(around * TAU));
        let flat = if y < 0.0 { 0.72 } else { 1.0 };
        station.position + (side * x + up * y * flat) * station.radius
    }

    fn eye_point(&self, side: usize, along: f64, around: f64) -> DVec3 {
        let (centre, gaze) = self.eyes[side];
        let right = DVec3::Y.cross(gaze).normalize();
        let up = gaze.cross(right);
        let (polar, azimuth) = (along * PI, around * TAU);
        let rim = right * cos(azimuth) + up * sin(azimuth);
        centre + (gaze * cos(polar) + rim * sin(polar)) * EYE_RADIUS
    }

    /// The unit normal, out of the surface's derivatives; poles take it from just beside them.
    fn normal(&self, part: Part, along: f64, around: f64) -> DVec3 {
        const H: f64 = 1e-3;
        let s = along.clamp(2.0 * H, 1.0 - 2.0 * H);
        let ds = self.point(part, s + H, around) - self.point(part, s - H, around);
        let da = self.point(part, s, around + H) - self.point(part, s, around - H);
        let normal = ds.cross(da).normalize();
        if is_reversed(part) { -normal } else { normal }
    }

    pub(crate) fn mesh(&self) -> Mesh {
        let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new() };
        for part in Part::all() {
            self.append(part, &mut mesh);
        }
        mesh
    }

    fn append(&self, part: Part, mesh: &mut Mesh) {
        let (rings, segments) = part.quads();
        let first = mesh.vertices.len();
        for ring in 0..=rings {
            for segment in 0..=segments {
                let (along, around) = (ring as f64 / rings as f64, segment as f64 / segments as f64);
                // The seam's two columns must not differ by the rounding of a full turn.
                let angle = if segment == segments { 0.0 } else { around };
                mesh.vertices.push(Vertex {
                    part,
                    along,
                    around,
                    position: self.point(part, along, angle),
                    normal: self.normal(part, along, angle),
                    uv: crate::skin::chart(part).uv(along, around),
                });
            }
        }
        let index = |ring: usize, segment: usize| (first + ring * (segments + 1) + segment) as u16;
        for ring in 0..rings {
            for segment in 0..segments {
                let [a, b, c, d] = [
                    index(ring, segment),
                    index(ring + 1, segment),
                    index(ring + 1, segment + 1),
                    index(ring, segment + 1),
                ];
                for [i, j, k] in [[a, b, c], [a, c, d]] {
                    let [p, q, r] = [i, j, k].map(|i| mesh.vertices[usize::from(i)].position);
                    if (q - p).cross(r - p).length() > 1e-12 {
                        mesh.triangles.push(if is_reversed(part) { [i, k, j] } else { [i, j, k] });
                    }
                }
            }
        }
    }
}

/// Whether `d/dalong x d/daround` points inward.
fn is_reversed(part: Part) -> bool {
    matches!(part, Part::Arm(_))
}

struct BodyAxis {
    centre: DVec3,
    radius: f64,
    tilt: f64,
}

fn body_axis(along: f64) -> BodyAxis {
    let value = |column: usize| spline(along, BODY.len(), |i| BODY[i][column]);
    // The square of the radius is interpolated: it falls linearly to 0 at a pole, which makes the pole round.
    let squared = spline(along, BODY.len(), |i| BODY[i][2] * BODY[i][2]);
    BodyAxis { centre: DVec3::new(0.0, value(0), value(1)), radius: sqrt(squared.max(0.0)), tilt: value(3) }
}

fn body_direction(angle: f64, tilt: f64) -> DVec3 {
    DVec3::new(cos(angle), sin(angle) * sin(tilt), sin(angle) * cos(tilt))
}

fn arm(index: usize) -> Vec<Station> {
    // A fixed shuffle of lengths and curls, so that no two neighbours look alike.
    let vary = [0.15, 0.8, 0.45, 1.0, 0.3, 0.65, 0.0, 0.9][index];
    let side = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
    let length = 0.40 + 0.06 * vary;
    let direction = (index as f64 + 0.5) * TAU / ARMS as f64;
    let heading = |t: f64| direction + side * (0.55 * sin(t * 4.6) * t + vary * 0.9 * t * t);
    let pitch = |t: f64| spline(t, ARM_PITCH.len(), |i| ARM_PITCH[i] * if i > 5 { 0.55 + 0.6 * vary } else { 1.0 });
    let mut position = DVec3::new(sin(direction) * 0.04, 0.094, cos(direction) * 0.04);
    (0..=ARM_STEPS)
        .map(|i| {
            let t = i as f64 / ARM_STEPS as f64;
            let round_tip = sqrt((1.0 - pow(((t - 0.97) / 0.03).max(0.0), 2.0)).max(0.0));
            let radius = (0.034 * pow(1.0 - t, 0.85) + 0.0035) * round_tip;
            let station = Station { position, heading: heading(t), pitch: pitch(t), radius };
            let middle = t + 0.5 / ARM_STEPS as f64;
            position += frame(heading(middle), pitch(middle)).2 * (length / ARM_STEPS as f64);
            station
        })
        .collect()
}

/// Side, up and forward of a heading and a pitch: a right-handed frame that does not twist.
pub(crate) fn frame(heading: f64, pitch: f64) -> (DVec3, DVec3, DVec3) {
    let (sh, ch, sp, cp) = (sin(heading), cos(heading), sin(pitch), cos(pitch));
    (DVec3::new(ch, 0.0, -sh), DVec3::new(-sh * sp, cp, -ch * sp), DVec3::new(sh * cp, sp, ch * cp))
}

pub(crate) fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// 1 at 0, 0 from 1 on, smooth between.
pub(crate) fn bump(x: f64) -> f64 {
    let y = (1.0 - x * x).max(0.0);
    y * y
}

pub(crate) fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Catmull-Rom spline through `count` values at equal steps, `t` in `[0, 1]`.
pub(crate) fn spline(t: f64, count: usize, value: impl Fn(usize) -> f64) -> f64 {
    let x = t.clamp(0.0, 1.0) * (count - 1) as f64;
    let i = (x as usize).min(count - 2);
    let t = x - i as f64;
    let (b, c) = (value(i), value(i + 1));
    let a = if i == 0 { 2.0 * b - c } else { value(i - 1) };
    let d = if i + 2 == count { 2.0 * c - b } else { value(i + 2) };
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}

/// Value noise in `[0, 1]` with one lattice point per unit.
pub(crate) fn noise(p: DVec3) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let w = f * f * (DVec3::splat(3.0) - 2.0 * f);
    let corner = |x: i64, y: i64, z: i64| hash([cell.x as i64 + x, cell.y as i64 + y, cell.z as i64 + z]);
    let row = |y, z| mix(corner(0, y, z), corner(1, y, z), w.x);
    mix(mix(row(0, 0), row(1, 0), w.y), mix(row(0, 1), row(1, 1), w.y), w.z)
}

/// A number in `[0, 1)` per lattice point: the SplitMix64 finaliser over the mixed coordinates.
pub(crate) fn hash(cell: [i64; 3]) -> f64 {
    let mut x = cell
        .iter()
        .fold(0x9E37_79B9_7F4A_7C15u64, |x, &c| (x ^ c as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9).rotate_left(29));
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
