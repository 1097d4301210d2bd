//! Joint weights under which the level's faces move as the source does, not its vertices alone.
//!
//! Weights of the closest points take each vertex where the source goes, and leave the faces between them behind where
//! weights run in curves. Here `sum_k sum_s a_s |x_s^k - M_s^k x_s|^2` is brought down, over points `x_s` of the level that
//! stand for areas `a_s`: `x_s^k` is where the corners of its face take it in pose `k`, `M_s^k` the motion of the source's
//! closest point. It is quadratic in the weights, by [`Poses::by_weights`] where the rest pose is not the bind pose;
//! accelerated projected descent (FISTA; Beck and Teboulle 2009) keeps the weights of each vertex on the simplex of the
//! bones that it came with.

use std::collections::BTreeMap;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::SkinSource;
use super::closest::{self, MatchLimits};
use crate::animation::Poses;
use crate::animation::{ordered, project};
use crate::data::{Influences, TriMesh};

/// Times that each face is divided into four; the corners are the points.
const DIVISIONS: usize = 2;
/// Steps of descent.
const STEPS: usize = 100;
/// How strongly weights are held where they are, relative to the steepest direction of their vertex.
const PULL: f32 = 1e-3;

/// Weights of `mesh`, a level in the rest pose, fitted to the poses; `influences` are those it has.
pub(super) fn fit(
    skin_source: &SkinSource<'_>,
    poses: &Poses<'_>,
    mesh: &TriMesh,
    influences: Vec<Influences>,
    limits: MatchLimits,
) -> Vec<Influences> {
    let samples = Samples::new(skin_source, mesh, limits);
    let start = samples.misses(poses, mesh, &influences);
    let problem = Problem::new(poses, mesh, &influences, &samples, &start);
    let fitted: Vec<Influences> = problem.solve(&influences).iter().map(ordered).collect();
    let error = |misses: &[Miss]| misses.iter().map(|miss| miss.error).sum::<f64>();
    // The derivatives hold near the start only if the rest pose is not the bind pose.
    if error(&samples.misses(poses, mesh, &fitted)) < error(&start) { fitted } else { influences }
}

/// Points of a level's faces.
struct Samples {
    points: Vec<Vec3>,
    /// Up to three vertices that each lies between, and how near it is to them; the parts sum to one.
    parts: Vec<[(u32, f32); 3]>,
    /// Zero where the source says nothing.
    areas: Vec<f32>,
    /// Influences of the source's closest point.
    source: Vec<Influences>,
}

/// How far the points miss the source in a pose.
struct Miss {
    /// Of each vertex: the misses of the points around it by their areas and parts, which is half the gradient at its place.
    around: Vec<Vec3>,
    /// Sum of the squares by areas.
    error: f64,
}

impl Samples {
    fn new(skin_source: &SkinSource<'_>, mesh: &TriMesh, limits: MatchLimits) -> Self {
        let mut fine = mesh.clone();
        let mut parts: Vec<[(u32, f32); 3]> =
            (0..mesh.positions.len() as u32).map(|v| [(v, 1.0), (v, 0.0), (v, 0.0)]).collect();
        for _ in 0..DIVISIONS {
            divide(&mut fine, &mut parts);
        }
        let found = closest::sample(skin_source, &fine, &fine.vertex_normals(), limits);
        let mut areas = vec![0.0; parts.len()];
        for (t, triangle) in fine.triangles.iter().enumerate() {
            let third = fine.area_vector(t).length() / 6.0;
            triangle.iter().filter(|&&v| found[v as usize].is_match).for_each(|&v| areas[v as usize] += third);
        }
        let source = found.iter().map(|sample| sample.weights.strongest()).collect();
        Self { points: fine.positions, parts, areas, source }
    }

    /// For each pose.
    fn misses(&self, poses: &Poses<'_>, mesh: &TriMesh, influences: &[Influences]) -> Vec<Miss> {
        let miss = |pose: usize| {
            let own = poses.motions_into(pose, influences);
            let wanted = poses.motions_into(pose, &self.source);
            let posed: Vec<Vec3> =
                mesh.positions.iter().zip(&own).map(|(p, motion)| motion.transform_point3(*p)).collect();
            let mut out = Miss { around: vec![Vec3::ZERO; posed.len()], error: 0.0 };
            for (((point, parts), &area), motion) in self.points.iter().zip(&self.parts).zip(&self.areas).zip(&wanted) {
                let place: Vec3 = parts.iter().map(|&(v, part)| posed[v as usize] * part).sum();
                let off = (place - motion.transform_point3(*point)) * area;
                parts.iter().for_each(|&(v, part)| out.around[v as usize] += off * part);
                out.error += if area > 0.0 { f64::from(off.length_squared() / area) } else { 0.0 };
            }
            out
        };
        (0..poses.all()).into_par_iter().map(miss).collect()
    }

    /// Products of the parts of two vertices, summed by area, for each vertex.
    fn gram(&self, vertices: usize) -> Vec<Vec<(u32, f32)>> {
        let mut sums: BTreeMap<(u32, u32), f32> = BTreeMap::new();
        for (parts, &area) in self.parts.iter().zip(&self.areas).filter(|(_, area)| **area > 0.0) {
            for (u, a) in parts.iter().filter(|(_, part)| *part > 0.0) {
                for (v, b) in parts.iter().filter(|(_, part)| *part > 0.0) {
                    *sums.entry((*u, *v)).or_default() += area * a * b;
                }
            }
        }
        let mut rows = vec![Vec::new(); vertices];
        sums.into_iter().for_each(|((u, v), sum)| rows[u as usize].push((v, sum)));
        rows
    }
}

/// Splits each face into four.
fn divide(mesh: &mut TriMesh, parts: &mut Vec<[(u32, f32); 3]>) {
    let mut middles: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut triangles = Vec::with_capacity(4 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(u, v)| {
            *middles.entry((u.min(v), u.max(v))).or_insert_with(|| {
                mesh.positions.push((mesh.positions[u as usize] + mesh.positions[v as usize]) * 0.5);
                parts.push(halfway(&parts[u as usize], &parts[v as usize]));
                parts.len() as u32 - 1
            })
        });
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    mesh.triangles = triangles;
}

/// The parts of the point between two of one face.
fn halfway(a: &[(u32, f32); 3], b: &[(u32, f32); 3]) -> [(u32, f32); 3] {
    let mut out = [(a[0].0, 0.0); 3];
    let mut used = 0;
    for &(vertex, part) in a.iter().chain(b).filter(|(_, part)| *part > 0.0) {
        let slot = out[..used].iter().position(|(v, _)| *v == vertex).unwrap_or(used);
        used = used.max(slot + 1);
        out[slot] = (vertex, out[slot].1 + 0.5 * part);
    }
    out
}

/// The error as a function of the weights, around those of the start.
struct Problem {
    poses: usize,
    /// Derivative of each vertex's place in each pose by each of its weights.
    by_weights: Vec<[Vec3; 4]>,
    /// Half the gradient at the start, by the places of vertices in poses.
    start: Vec<Vec3>,
    gram: Vec<Vec<(u32, f32)>>,
    /// Bound of the curvature along the weights of each vertex.
    steepness: Vec<f32>,
}

impl Problem {
    fn new(poses: &Poses<'_>, mesh: &TriMesh, influences: &[Influences], samples: &Samples, start: &[Miss]) -> Self {
        let n = poses.all();
        let gram = samples.gram(influences.len());
        let by_weights: Vec<[Vec3; 4]> = (0..n * influences.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let own = &influences[i / n];
                let derivatives = poses.by_weights(i % n, own, mesh.positions[i / n]);
                std::array::from_fn(|k| if own.weights[k] > 0.0 { derivatives[k] } else { Vec3::ZERO })
            })
            .collect();
        let steepness = gram.iter().zip(by_weights.chunks(n)).map(|(row, derivatives)| {
            let reach: f32 = derivatives.iter().flatten().map(|d| d.length_squared()).sum();
            row.iter().map(|(_, product)| product).sum::<f32>() * reach
        });
        let steepness = steepness.collect();
        let start = (0..n * influences.len()).map(|i| start[i % n].around[i / n]).collect();
        Self { poses: n, by_weights, start, gram, steepness }
    }

    fn solve(&self, influences: &[Influences]) -> Vec<Influences> {
        let origin: Vec<Vec4> = influences.iter().map(|i| i.weights.into()).collect();
        let slots: Vec<usize> = influences.iter().map(|i| i.weights.iter().filter(|w| **w > 0.0).count()).collect();
        let (mut weights, mut ahead, mut momentum) = (origin.clone(), origin.clone(), 1.0f32);
        for _ in 0..STEPS {
            let moved = self.moved(&ahead, &origin);
            let next: Vec<Vec4> = (0..origin.len())
                .into_par_iter()
                .with_min_len(256)
                .map(|v| {
                    let steepness = self.steepness[v];
                    if slots[v] < 2 || steepness <= 0.0 {
                        return origin[v];
                    }
                    let pull = (ahead[v] - origin[v]) * PULL;
                    let step = self.gradient(v, &moved) / steepness + pull;
                    let mut stepped = (ahead[v] - step / (1.0 + PULL)).to_array();
                    project(&mut stepped[..slots[v]]);
                    stepped.into()
                })
                .collect();
            let larger = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
            let part = (momentum - 1.0) / larger;
            ahead = next.iter().zip(&weights).map(|(next, last)| *next + (*next - *last) * part).collect();
            (weights, momentum) = (next, larger);
        }
        let with = |(i, w): (&Influences, &Vec4)| Influences { joints: i.joints, weights: w.to_array() };
        influences.iter().zip(&weights).map(with).collect()
    }

    /// How far each vertex goes in each pose as its weights change.
    fn moved(&self, weights: &[Vec4], origin: &[Vec4]) -> Vec<Vec3> {
        let along = |(i, derivatives): (usize, &[Vec3; 4])| {
            let change = (weights[i / self.poses] - origin[i / self.poses]).to_array();
            derivatives.iter().zip(change).map(|(d, change)| *d * change).sum()
        };
        self.by_weights.par_iter().with_min_len(1024).enumerate().map(along).collect()
    }

    /// Half the gradient by the weights of a vertex.
    fn gradient(&self, v: usize, moved: &[Vec3]) -> Vec4 {
        let mut gradient = Vec4::ZERO;
        for pose in 0..self.poses {
            let around = self.gram[v].iter().map(|&(u, product)| moved[u as usize * self.poses + pose] * product);
            let by_place = self.start[v * self.poses + pose] + around.sum::<Vec3>();
            gradient += Vec4::from(self.by_weights[v * self.poses + pose].map(|d| d.dot(by_place)));
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat4;

    use super::*;
    use crate::Cancellation;
    use crate::data::{Bone, Model, Pose, Rig, Surface};
    use crate::geometry::Bvh;

    /// A strip along x from 0 to 4 in 32 columns. The second bone, whose weight is the square of the way, is lifted by one.
    fn curved() -> Model {
        let bone = |node| Bone { node, inverse_bind: Mat4::IDENTITY, rest_world: Mat4::IDENTITY };
        let pose = Pose { frame: Some((0, 0.0)), world: vec![Mat4::IDENTITY, Mat4::from_translation(Vec3::Z)] };
        let rig = Some(Rig { bones: vec![bone(0), bone(1)], source_skin: Some(0), poses: vec![pose] });
        let mut surface = Surface::default();
        for i in 0..=32 {
            let t = i as f32 / 32.0;
            for y in [0.0, 1.0] {
                surface.positions.push(Vec3::new(4.0 * t, y, 0.0));
                surface.normals.push(Vec3::Z);
                surface
                    .influences
                    .push(ordered(&Influences { joints: [0, 1, 0, 0], weights: [1.0 - t * t, t * t, 0.0, 0.0] }));
            }
        }
        for i in 0..32 {
            surface.triangles.extend([[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]);
        }
        surface.material = vec![0; surface.triangles.len()];
        Model { surface, rig, ..Model::empty("curve") }
    }

    /// Two quads in place of thirty-two.
    fn coarse() -> TriMesh {
        let positions =
            [0.0, 2.0, 4.0].iter().flat_map(|&x| [Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1.0, 0.0)]).collect();
        TriMesh { positions, triangles: vec![[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]] }
    }

    const LIMITS: MatchLimits = MatchLimits { distance: 1.0, cosine: 0.0 };

    fn part(influences: &Influences) -> f32 {
        let slots = influences.joints.iter().zip(influences.weights);
        slots.filter(|(joint, _)| **joint == 1).map(|(_, weight)| weight).sum()
    }

    #[test]
    fn a_curve_is_fitted_between_its_points() {
        let model = curved();
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        let skin_source = SkinSource::new(&model, &bvh);
        let poses = Poses::of(&model, 1, 1, &Cancellation::default()).expect("it moves");
        // Between points on it the chord lies above a parabola; the fitted one lies below it at its middle.
        let at = |t: f32| Influences { joints: [0, 1, 0, 0], weights: [1.0 - t, t, 0.0, 0.0] };
        let given: Vec<Influences> = [1e-6, 0.25, 1.0 - 1e-6].into_iter().flat_map(|t| [at(t), at(t)]).collect();
        let samples = Samples::new(&skin_source, &coarse(), LIMITS);
        let error = |i: &[Influences]| samples.misses(&poses, &coarse(), i)[0].error;
        let fitted = fit(&skin_source, &poses, &coarse(), given.clone(), LIMITS);
        assert!(part(&fitted[2]) < 0.23 && part(&fitted[3]) < 0.23, "{fitted:?}");
        assert!(error(&fitted) < 0.6 * error(&given), "{} {}", error(&fitted), error(&given));
        assert!(fitted.iter().all(|i| (i.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn what_follows_the_source_stays() {
        let mut model = curved();
        let positions = model.surface.positions.clone();
        for (influences, p) in model.surface.influences.iter_mut().zip(&positions) {
            let t = p.x / 4.0;
            *influences = ordered(&Influences { joints: [0, 1, 0, 0], weights: [1.0 - t, t, 0.0, 0.0] });
        }
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        let skin_source = SkinSource::new(&model, &bvh);
        let poses = Poses::of(&model, 1, 1, &Cancellation::default()).expect("it moves");
        let at =
            |p: &Vec3| ordered(&Influences { joints: [0, 1, 0, 0], weights: [1.0 - p.x / 4.0, p.x / 4.0, 0.0, 0.0] });
        let exact: Vec<Influences> = coarse().positions.iter().map(at).collect();
        let fitted = fit(&skin_source, &poses, &coarse(), exact.clone(), LIMITS);
        assert!(fitted.iter().zip(&exact).all(|(a, b)| (part(a) - part(b)).abs() < 1e-4), "{fitted:?}");
    }

    #[test]
    fn points_of_a_divided_face_lie_where_their_parts_say() {
        let mut fine = coarse();
        let mut parts: Vec<[(u32, f32); 3]> = (0..6).map(|v| [(v, 1.0), (v, 0.0), (v, 0.0)]).collect();
        divide(&mut fine, &mut parts);
        divide(&mut fine, &mut parts);
        assert_eq!((fine.triangles.len(), fine.positions.len(), parts.len()), (64, 45, 45));
        for (point, parts) in fine.positions.iter().zip(&parts) {
            let place: Vec3 = parts.iter().map(|&(v, part)| coarse().positions[v as usize] * part).sum();
            assert!(place.distance(*point) < 1e-6);
        }
    }
}
