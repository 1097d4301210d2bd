//! The twenty shapes that the village is made of.

use std::f32::consts::{PI, TAU};

use bevy::math::{Quat, Vec2, Vec3, vec2, vec3};

const WOOD: Vec3 = vec3(0.36, 0.22, 0.12);
const TILE: Vec3 = vec3(0.55, 0.17, 0.10);
const STONE: Vec3 = vec3(0.42, 0.41, 0.39);
const LEAF: Vec3 = vec3(0.16, 0.33, 0.08);
const NEEDLE: Vec3 = vec3(0.07, 0.22, 0.12);
const STRAW: Vec3 = vec3(0.72, 0.56, 0.20);

/// A mesh with a colour at each vertex, in metres. It stands on the ground.
#[derive(Default)]
pub(crate) struct Shape {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) colors: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A number from 0 to 1 that looks random.
pub(crate) fn chance(seed: u32) -> f32 {
    let mut x = seed.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
    x = (x ^ (x >> 16)).wrapping_mul(0x7FEB_352D);
    x = (x ^ (x >> 15)).wrapping_mul(0x846C_A68B);
    (x ^ (x >> 16)) as f32 / u32::MAX as f32
}

impl Shape {
    /// Adds a patch of `rows` by `columns` cells over the unit square. Its front is where u runs to the right and v up.
    fn patch(&mut self, (rows, columns): (u32, u32), color: Vec3, point: impl Fn(f32, f32) -> Vec3) {
        const STEP: f32 = 1e-3;
        let first = self.positions.len() as u32;
        for (i, j) in (0..=rows).flat_map(|i| (0..=columns).map(move |j| (i, j))) {
            let (u, v) = (j as f32 / columns as f32, i as f32 / rows as f32);
            // At a pole, the patch has a normal a little beside it.
            let w = v.clamp(STEP, 1.0 - STEP);
            let along = point(u + STEP, w) - point(u - STEP, w);
            let up = point(u, (w + STEP).min(1.0)) - point(u, (w - STEP).max(0.0));
            self.positions.push(point(u, v));
            self.normals.push(along.cross(up).normalize_or(Vec3::Y));
            let tint = 0.85 + 0.3 * chance(first.wrapping_mul(31).wrapping_add(i * 7 + j));
            self.colors.push((color * tint).min(Vec3::ONE));
        }
        let corner = |i: u32, j: u32| first + i * (columns + 1) + j;
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let [a, b, c, d] = [corner(i, j), corner(i, j + 1), corner(i + 1, j), corner(i + 1, j + 1)];
            self.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }

    /// Adds a body of revolution about the y axis: radius and height from the bottom to the top.
    fn lathe(&mut self, at: Vec3, profile: &[Vec2], (rows, sides): (u32, u32), color: Vec3) {
        self.patch((rows, sides), color, |u, v| {
            let place = v * (profile.len() - 1) as f32;
            let i = (place as usize).min(profile.len() - 2);
            let r = profile[i].lerp(profile[i + 1], place - i as f32);
            at + vec3(r.x * (TAU * u).sin(), r.y, r.x * (TAU * u).cos())
        });
    }

    /// Adds a ball with bumps; `rings` rings of twice as many cells.
    fn ball(&mut self, center: Vec3, radius: Vec3, (rings, bumps): (u32, f32), color: Vec3) {
        self.patch((rings, 2 * rings), color, |u, v| {
            let (phi, theta) = (TAU * u, PI * v);
            let bump =
                1.0 + bumps * ((5.0 * theta).sin() * (4.0 * phi).cos() + 0.5 * (9.0 * theta).sin() * (7.0 * phi).sin());
            center + radius * bump * vec3(theta.sin() * phi.sin(), -theta.cos(), theta.sin() * phi.cos())
        });
    }

    /// Adds a log with rounded ends.
    fn log(&mut self, from: Vec3, to: Vec3, radius: f32, color: Vec3) {
        let turn = Quat::from_rotation_arc(Vec3::Y, (to - from).normalize());
        let length = from.distance(to);
        let profile = [vec2(0.0, 0.0), vec2(radius, 0.0), vec2(radius, length), vec2(0.0, length)];
        let before = self.positions.len();
        self.lathe(Vec3::ZERO, &profile, (6, 10), color);
        self.positions[before..].iter_mut().for_each(|p| *p = from + turn * *p);
        self.normals[before..].iter_mut().for_each(|n| *n = turn * *n);
    }

    fn house(seed: u32) -> Self {
        let mut out = Self::default();
        let (x, z) = (2.2 + chance(seed), 2.6 + 1.4 * chance(seed + 1));
        let (height, ridge, radius) = (2.4, 4.2 + chance(seed + 2), 0.14);
        for i in 0..9 {
            let y = 0.15 + 0.27 * i as f32;
            for side in [-1.0, 1.0] {
                out.log(vec3(-x - 0.3, y, side * z), vec3(x + 0.3, y, side * z), radius, WOOD);
                out.log(vec3(side * x, y, -z - 0.3), vec3(side * x, y, z + 0.3), radius, WOOD);
            }
        }
        // Planks of the gables.
        for (side, i) in [-1.0, 1.0].into_iter().flat_map(|side| (0..10).map(move |i| (side, i))) {
            let at = -x + 0.1 + 2.0 * x * (i as f32 + 0.45) / 10.0;
            let top = height + (ridge - height) * (1.0 - (at / x).abs());
            out.log(vec3(at, height - 0.1, side * z), vec3(at, top.max(height), side * z), 0.17, 0.8 * WOOD);
        }
        for (side, row, column) in
            [-1.0, 1.0].into_iter().flat_map(|s| (0..9).flat_map(move |r| (0..11).map(move |c| (s, r, c))))
        {
            let eaves = vec3(side * (x + 0.5), height - 0.25, 0.0);
            let top = vec3(0.0, ridge + 0.1, 0.0);
            let step = (top - eaves) / 9.0;
            let width = 2.0 * (z + 0.5) / 11.0;
            let origin = eaves + row as f32 * step + Vec3::Z * (-z - 0.5 + column as f32 * width);
            let away = step.cross(Vec3::Z * -side).normalize();
            let color = TILE * (0.75 + 0.5 * chance(seed + row * 37 + column));
            out.patch((2, 4), color, |u, v| {
                let u = if side > 0.0 { 1.0 - u } else { u };
                origin + 1.25 * v * step + Vec3::Z * width * u + away * (0.08 * (PI * u).sin() + 0.06 * (1.0 - v))
            });
        }
        let chimney =
            [vec2(0.45, 0.0), vec2(0.45, 2.6), vec2(0.55, 2.6), vec2(0.55, 2.9), vec2(0.3, 2.9), vec2(0.3, 2.0)];
        out.lathe(vec3(0.4 * x, ridge - 1.6, 0.3 * z), &chimney, (10, 8), STONE);
        out
    }

    fn tree(seed: u32) -> Self {
        let mut out = Self::default();
        let trunk = [vec2(0.42, 0.0), vec2(0.25, 0.6), vec2(0.2, 1.8), vec2(0.12, 3.4)];
        out.lathe(Vec3::ZERO, &trunk, (12, 14), WOOD);
        for i in 0..6 {
            let of = |k: u32| chance(seed + 11 * i + k);
            let turn = TAU * (i as f32 / 6.0 + 0.1 * of(0));
            let center = vec3(0.9 * turn.sin(), 2.7 + 1.6 * of(1), 0.9 * turn.cos());
            out.ball(center, Vec3::splat(0.8 + 0.4 * of(2)), (16, 0.08), LEAF * (0.8 + 0.5 * of(3)));
        }
        out
    }

    fn conifer(seed: u32) -> Self {
        let mut out = Self::default();
        out.lathe(Vec3::ZERO, &[vec2(0.25, 0.0), vec2(0.16, 2.0)], (6, 12), WOOD);
        for i in 0..7 {
            let part = i as f32 / 7.0;
            let (radius, low) = (1.5 * (1.0 - 0.85 * part), 0.7 + 4.2 * part + 0.2 * chance(seed + i));
            out.patch((7, 48), NEEDLE * (0.8 + 0.5 * part), |u, v| {
                let droop = 0.16 * (1.0 - v) * (12.0 * TAU * u).cos();
                let r = radius * (1.0 - v) * (1.0 + 0.12 * (12.0 * TAU * u).sin());
                vec3(r * (TAU * u).sin(), low + 1.3 * v - droop, r * (TAU * u).cos())
            });
        }
        out
    }

    fn rock(seed: u32) -> Self {
        let mut out = Self::default();
        let of = |k: u32| 0.4 + 0.5 * chance(seed + k);
        out.ball(vec3(0.0, 0.3, 0.0), vec3(of(0), of(1), of(2)), (24, 0.05 + 0.06 * of(3)), STONE);
        out
    }

    fn barrel() -> Self {
        let mut out = Self::default();
        let side = |t: f32| vec2(0.32 + 0.1 * (PI * t).sin(), t);
        let profile: Vec<Vec2> = [vec2(0.0, 0.0)].into_iter().chain((0..=8).map(|i| side(i as f32 / 8.0))).collect();
        out.lathe(
            Vec3::ZERO,
            &[&profile[..], &[vec2(0.28, 1.0), vec2(0.28, 0.92), vec2(0.0, 0.92)]].concat(),
            (36, 24),
            WOOD,
        );
        for height in [0.18_f32, 0.5, 0.82] {
            let r = 0.33 + 0.1 * (PI * height).sin();
            let hoop = [
                vec2(r, height - 0.04),
                vec2(r + 0.02, height - 0.03),
                vec2(r + 0.02, height + 0.03),
                vec2(r, height + 0.04),
            ];
            out.lathe(Vec3::ZERO, &hoop, (6, 32), 0.6 * STONE);
        }
        out
    }

    fn fence() -> Self {
        let mut out = Self::default();
        for i in 0..7 {
            let x = -1.5 + 0.5 * i as f32;
            out.log(vec3(x, 0.0, 0.0), vec3(x, 1.0 + 0.15 * chance(i), 0.02), 0.06, WOOD);
        }
        for y in [0.35, 0.75] {
            out.log(vec3(-1.7, y, 0.07), vec3(1.7, y + 0.03, 0.07), 0.05, 0.8 * WOOD);
        }
        out
    }

    fn haystack() -> Self {
        let mut out = Self::default();
        out.ball(vec3(0.0, 0.7, 0.0), vec3(1.1, 1.2, 1.1), (26, 0.05), STRAW);
        out
    }

    fn well() -> Self {
        let mut out = Self::default();
        for (row, i) in (0..4).flat_map(|row| (0..12).map(move |i| (row, i))) {
            let turn = TAU * (i as f32 + 0.5 * (row % 2) as f32) / 12.0;
            let center = vec3(turn.sin(), 0.13 + 0.24 * row as f32, turn.cos());
            out.ball(center, vec3(0.27, 0.15, 0.27), (6, 0.04), STONE * (0.8 + 0.4 * chance(row * 13 + i)));
        }
        for side in [-1.0, 1.0] {
            out.log(vec3(side, 0.0, 0.0), vec3(side, 2.4, 0.0), 0.1, WOOD);
        }
        out.log(vec3(-1.1, 2.2, 0.0), vec3(1.1, 2.2, 0.0), 0.08, WOOD);
        out.lathe(vec3(0.0, 2.3, 0.0), &[vec2(1.6, 0.0), vec2(0.0, 1.1)], (8, 24), TILE);
        out
    }

    fn lamp() -> Self {
        let mut out = Self::default();
        let post = [
            vec2(0.16, 0.0),
            vec2(0.12, 0.2),
            vec2(0.05, 0.4),
            vec2(0.05, 2.6),
            vec2(0.16, 2.8),
            vec2(0.2, 3.2),
            vec2(0.0, 3.5),
        ];
        out.lathe(Vec3::ZERO, &post, (30, 16), 0.4 * STONE);
        out.ball(vec3(0.0, 3.0, 0.0), Vec3::splat(0.17), (10, 0.0), vec3(1.0, 0.9, 0.6));
        out
    }
}

/// A shape, its name, how often it stands in the village, and the room that it takes, in metres.
pub(crate) struct Kind {
    pub(crate) name: String,
    pub(crate) count: u32,
    pub(crate) room: f32,
    pub(crate) shape: Shape,
}

/// All kinds: 20 of them, 300 objects.
pub(crate) fn kinds() -> Vec<Kind> {
    let mut kinds = Vec::new();
    let mut add = |name: String, count, room, shape| kinds.push(Kind { name, count, room, shape });
    (0..4).for_each(|i| add(format!("House{i}"), 6, 6.0, Shape::house(100 * i)));
    (0..4).for_each(|i| add(format!("Tree{i}"), 20, 2.6, Shape::tree(1000 + 100 * i)));
    (0..3).for_each(|i| add(format!("Conifer{i}"), 18, 2.2, Shape::conifer(2000 + 100 * i)));
    (0..4).for_each(|i| add(format!("Rock{i}"), 15, 1.5, Shape::rock(3000 + 100 * i)));
    add("Barrel".into(), 30, 1.0, Shape::barrel());
    add("Fence".into(), 34, 2.0, Shape::fence());
    add("Haystack".into(), 8, 2.4, Shape::haystack());
    add("Well".into(), 2, 2.6, Shape::well());
    add("Lamp".into(), 8, 1.0, Shape::lamp());
    kinds
}
