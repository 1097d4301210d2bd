//! Moves apart what passes through each other by a little.
//!
//! Shells that lie close together, such as a car's body and what is glued to it, begin to cross as their facets grow.
//! Contacts are resolved one after another, as the constraints of position based dynamics (Müller et al. 2007): what
//! counts of each face is the part that lies over the other, and both move by the least way that takes it to one side.
//! Pairs that pass deep through each other, as an arm does through the body, are left as they are.

use std::collections::{BTreeSet, HashSet};

use glam::DVec3;

use super::Simplifier;
use crate::geometry::{Box3, intersect};

/// Most rounds over all pairs, and those after which it is given up that fewer faces cross.
const ROUNDS: usize = 80;
const PATIENCE: usize = 16;
/// Over-relaxation: contacts pull at each other.
const BEYOND: f64 = 1.5;
/// Part of the faces above which it is not tried.
const MOST: f64 = 0.2;
/// Gap that is left between two faces, in the unit sphere.
const GAP: f64 = 1e-4;
/// Farthest way of a vertex, as a part of the mean length of the edges around it.
const FARTHEST: f64 = 0.5;
/// Least cosine between a face's normal before and after.
const MAX_TURN: f64 = 0.5;
/// Parts of their way at which moved vertices may stay.
const PARTS: [f64; 4] = [0.0, 0.25, 0.5, 0.75];
/// Rounds in which vertices go back.
const ROUNDS_BACK: usize = 2;

impl Simplifier {
    /// Moves vertices until fewer faces, at best none, pass through each other, and watches that from here on. Contacts
    /// as deep as a part `deepest` of the mean edge are resolved.
    pub(in crate::simplify) fn resolve_intersections(&mut self, deepest: f64) {
        if self.tree.is_none() {
            self.watch_intersections();
        }
        let start = self.positions.clone();
        if let Some(best) = self.least_tangled(&start, deepest) {
            self.positions = best;
            self.watch_intersections();
            self.go_back(&start);
        }
    }

    /// Positions of the vertices where the fewest faces pass through each other; `None` if nothing moves.
    fn least_tangled(&mut self, start: &[DVec3], deepest: f64) -> Option<Vec<DVec3>> {
        let faces: Vec<u32> = self.live().collect();
        let deepest = deepest * self.mean_edge(&faces);
        let mut pairs = self.pairs_of(&faces.iter().copied().collect());
        // What cannot be resolved waits until one of its faces moves.
        let mut waiting: Vec<(u32, u32)> = Vec::new();
        let (mut fewest, mut best, mut since) = (faces_of_pairs(&pairs, &[]), None, 0);
        if fewest as f64 > MOST * faces.len() as f64 {
            return None;
        }
        for _ in 0..ROUNDS {
            let mut moved: BTreeSet<u32> = BTreeSet::new();
            for &(a, b) in &pairs {
                self.push_apart(a, b, start, deepest, &mut moved);
            }
            if moved.is_empty() || self.cancellation.is_cancelled() {
                break;
            }
            waiting.append(&mut pairs);
            waiting.retain(|(a, b)| !moved.contains(a) && !moved.contains(b));
            pairs = self.pairs_of(&moved);
            let crossing = faces_of_pairs(&pairs, &waiting);
            since += 1;
            if crossing < fewest {
                (fewest, best, since) = (crossing, Some(self.positions.clone()), 0);
            }
            if pairs.is_empty() || since > PATIENCE {
                break;
            }
        }
        best.or_else(|| (self.positions != start).then(|| start.to_vec()))
    }

    /// Pairs that pass through each other, at least one of them in `faces`.
    fn pairs_of(&self, faces: &BTreeSet<u32>) -> Vec<(u32, u32)> {
        let mut pairs = Vec::new();
        let Some(tree) = &self.tree else { return pairs };
        for &f in faces {
            let corners = self.corners(f);
            tree.any(&Box3::around(&corners), |g| {
                if g != f && !(g < f && faces.contains(&g)) && intersect(&corners, &self.corners(g)) {
                    pairs.push((f.min(g), f.max(g)));
                }
                false
            });
        }
        pairs.sort_unstable();
        pairs
    }

    fn mean_edge(&self, faces: &[u32]) -> f64 {
        let edges = |&f: &u32| {
            let corners = self.corners(f);
            (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).sum::<f64>()
        };
        faces.iter().map(edges).sum::<f64>() / (3 * faces.len().max(1)) as f64
    }

    /// Resolves a contact, unless it is too deep. Corners that would turn a face over stay where they are.
    fn push_apart(&mut self, a: u32, b: u32, start: &[DVec3], deepest: f64, moved: &mut BTreeSet<u32>) {
        let contact = Contact::between(&self.corners(a), &self.corners(b));
        let Some(contact) = contact.filter(|contact| contact.depth <= deepest) else { return };
        let mut parts: Vec<(u32, f64)> = Vec::with_capacity(6);
        for (v, part) in self.face(a).into_iter().chain(self.face(b)).zip(contact.parts) {
            match parts.iter_mut().find(|other| other.0 == v) {
                Some(shared) => shared.1 += part,
                None => parts.push((v, part)),
            }
        }
        while let Some(places) = self.places_apart(&contact, &parts, start) {
            let before: Vec<DVec3> = parts.iter().map(|(v, _)| self.positions[*v as usize]).collect();
            parts.iter().zip(&places).for_each(|((v, _), place)| self.positions[*v as usize] = *place);
            let turned: Vec<u32> =
                parts.iter().map(|(v, _)| *v).filter(|&v| !self.is_upright_around(v, start)).collect();
            if turned.is_empty() {
                for ((&(v, _), place), _) in parts.iter().zip(places).zip(before).filter(|((_, p), before)| p != before)
                {
                    moved.extend(self.faces_of(v).map(|(f, _)| f));
                    self.move_vertex(v, place);
                }
                return;
            }
            parts.iter().zip(before).for_each(|((v, _), place)| self.positions[*v as usize] = place);
            parts.retain(|(v, _)| !turned.contains(v));
        }
    }

    /// Where a contact takes the vertices that have `parts` in it; `None` if they cannot resolve it.
    fn places_apart(&self, contact: &Contact, parts: &[(u32, f64)], start: &[DVec3]) -> Option<Vec<DVec3>> {
        // The less surface hangs on a vertex, the farther it moves.
        let lightness: Vec<f64> = parts.iter().map(|(v, _)| 1.0 / self.area_around(*v, start).max(1e-12)).collect();
        let norm: f64 = parts.iter().zip(&lightness).map(|((_, part), light)| light * part * part).sum();
        let step = contact.direction * ((BEYOND * contact.depth + GAP) / norm);
        let place = |(&(v, part), light): (&(u32, f64), &f64)| {
            let origin = start[v as usize];
            let way = self.positions[v as usize] + step * (part * light) - origin;
            origin + way.clamp_length_max(FARTHEST * self.edge_around(v, start))
        };
        (norm > 0.0).then(|| parts.iter().zip(&lightness).map(place).collect())
    }

    /// Takes vertices as far back as they can go without more pairs that cross.
    fn go_back(&mut self, start: &[DVec3]) {
        for _ in 0..ROUNDS_BACK {
            for v in 0..start.len() as u32 {
                let (origin, place) = (start[v as usize], self.positions[v as usize]);
                if place == origin {
                    continue;
                }
                let gap = GAP / place.distance(origin);
                let is_free = |part: f64| !self.moving_intersects_more(v, origin.lerp(place, part));
                if let Some(part) = PARTS.into_iter().find(|&part| is_free(part) && is_free(part - gap)) {
                    self.move_vertex(v, origin.lerp(place, part));
                }
            }
        }
    }

    fn move_vertex(&mut self, v: u32, place: DVec3) {
        self.positions[v as usize] = place;
        let corners: Vec<(u32, [DVec3; 3])> = self.faces_of(v).map(|(f, _)| (f, self.corners(f))).collect();
        if let Some(tree) = &mut self.tree {
            corners.iter().for_each(|(f, corners)| tree.set(*f, corners));
        }
    }

    fn area_around(&self, v: u32, positions: &[DVec3]) -> f64 {
        self.faces_of(v).map(|(f, _)| 0.5 * area_vector(self.face(f), positions).length()).sum()
    }

    /// Mean length of the edges of a vertex.
    fn edge_around(&self, v: u32, positions: &[DVec3]) -> f64 {
        let length = |w: u32| positions[w as usize].distance(positions[v as usize]);
        let (mut sum, mut count) = (0.0, 0);
        for (f, k) in self.faces_of(v) {
            let face = self.face(f);
            sum += length(face[(k + 1) % 3]) + length(face[(k + 2) % 3]);
            count += 2;
        }
        sum / f64::from(count.max(1))
    }

    fn is_upright_around(&self, v: u32, start: &[DVec3]) -> bool {
        self.faces_of(v).all(|(f, _)| {
            let (old, new) = (area_vector(self.face(f), start), area_vector(self.face(f), &self.positions));
            old.dot(new) > MAX_TURN * old.length() * new.length()
        })
    }
}

/// Number of faces in some pair.
fn faces_of_pairs(pairs: &[(u32, u32)], others: &[(u32, u32)]) -> usize {
    pairs.iter().chain(others).flat_map(|&(a, b)| [a, b]).collect::<HashSet<u32>>().len()
}

/// Twice the area of a face times its unit normal.
fn area_vector(face: [u32; 3], positions: &[DVec3]) -> DVec3 {
    let [a, b, c] = face.map(|v| positions[v as usize]);
    (b - a).cross(c - a)
}

/// How two faces are taken apart along the normal of one of them.
#[derive(Debug)]
struct Contact {
    /// Of unit length.
    direction: DVec3,
    /// How far they reach into each other.
    depth: f64,
    /// What a motion of each corner of the first and the second face along `direction` does to the depth.
    parts: [f64; 6],
}

impl Contact {
    /// The shallower of both ways; `None` if the faces are apart.
    fn between(a: &[DVec3; 3], b: &[DVec3; 3]) -> Option<Self> {
        let over_a = Self::over(a, b);
        let over_b = Self::over(b, a).map(|mut contact| {
            contact.parts.rotate_left(3);
            contact
        });
        match (over_a, over_b) {
            (Some(a), Some(b)) => Some(if b.depth < a.depth { b } else { a }),
            (a, b) => a.or(b),
        }
    }

    /// What of `face` lies over or under `floor` moves to one side of it.
    fn over(floor: &[DVec3; 3], face: &[DVec3; 3]) -> Option<Self> {
        let normal = (floor[1] - floor[0]).cross(floor[2] - floor[0]).try_normalize()?;
        let place = |w: DVec3| face[0] * w.x + face[1] * w.y + face[2] * w.z;
        // Corners of that part, barycentric in `face`.
        let mut polygon = vec![DVec3::X, DVec3::Y, DVec3::Z];
        for k in 0..3 {
            let inward = normal.cross(floor[(k + 1) % 3] - floor[k]);
            polygon = clipped(&polygon, |w| (place(w) - floor[k]).dot(inward));
        }
        let heights = polygon.iter().map(|&w| ((place(w) - floor[0]).dot(normal), w));
        let (highest, lowest) =
            (heights.clone().max_by(|a, b| a.0.total_cmp(&b.0))?, heights.min_by(|a, b| a.0.total_cmp(&b.0))?);
        if highest.0 <= 0.0 || lowest.0 >= 0.0 {
            return None;
        }
        let upwards = -lowest.0 <= highest.0;
        let (depth, above) = if upwards { (-lowest.0, lowest.1) } else { (highest.0, highest.1) };
        let below = -barycentric(floor, place(above));
        let parts = [below.x, below.y, below.z, above.x, above.y, above.z];
        Some(Self { direction: if upwards { normal } else { -normal }, depth, parts })
    }
}

/// The part of a convex polygon where a linear function is not negative (Sutherland and Hodgman 1974).
fn clipped(polygon: &[DVec3], height: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (hp, hq) = (height(p), height(q));
        if hp >= 0.0 {
            out.push(p);
        }
        if hp * hq < 0.0 {
            out.push(p.lerp(q, hp / (hp - hq)));
        }
    }
    out
}

/// Barycentric coordinates of the projection of `p` on a triangle that has an area.
fn barycentric([a, b, c]: &[DVec3; 3], p: DVec3) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let (v, w) = ((p - a).cross(c - a).dot(normal), (b - a).cross(p - a).dot(normal));
    let (v, w) = (v / normal.length_squared(), w / normal.length_squared());
    DVec3::new(1.0 - v - w, v, w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::TriMesh;
    use crate::geometry::self_intersecting;
    use glam::Vec3;

    const FLOOR: [DVec3; 3] = [DVec3::new(-9.0, -9.0, 0.0), DVec3::new(9.0, -9.0, 0.0), DVec3::new(0.0, 9.0, 0.0)];

    #[test]
    fn a_corner_under_the_floor_is_lifted_by_its_depth() {
        let face = [DVec3::new(0.0, 0.0, -0.1), DVec3::new(1.0, 0.0, 0.5), DVec3::new(0.0, 1.0, 0.5)];
        let contact = Contact::between(&FLOOR, &face).expect("they cross");
        assert!(contact.direction.abs_diff_eq(DVec3::Z, 1e-12) && (contact.depth - 0.1).abs() < 1e-12);
        let expected = [-0.25, -0.25, -0.5, 1.0, 0.0, 0.0];
        assert!(contact.parts.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{contact:?}");
        let other = Contact::between(&face, &FLOOR).expect("they cross");
        assert!((other.depth - contact.depth).abs() < 1e-12 && other.parts[..3] == contact.parts[3..]);
    }

    #[test]
    fn what_lies_beside_the_floor_does_not_count() {
        // A tenth below the floor at one end of it, half as much above at the other, and far above behind that.
        let face = [DVec3::new(-1.0, 0.0, -0.1), DVec3::new(-1.0, 0.5, -0.1), DVec3::new(40.0, 0.0, 1.018)];
        let contact = Contact::over(&FLOOR, &face).expect("they cross");
        assert!(contact.direction.abs_diff_eq(-DVec3::Z, 1e-12) && (contact.depth - 0.05).abs() < 0.005, "{contact:?}");
        assert!(Contact::between(&FLOOR, &face.map(|p| p + DVec3::Z * 0.2)).is_none());
    }

    /// Flat squares of `2 n n` triangles on top of each other, their shapes given.
    fn sheets(n: u32, heights: [fn(f32, f32) -> f32; 2]) -> TriMesh {
        let mut mesh = TriMesh::default();
        for height in heights {
            let base = mesh.positions.len() as u32;
            let at = |i: u32| i as f32 / n as f32;
            let places = (0..(n + 1) * (n + 1)).map(|i| (at(i % (n + 1)), at(i / (n + 1))));
            mesh.positions.extend(places.map(|(x, y)| Vec3::new(x, y, height(x, y))));
            let quads = (0..n * n).map(|i| base + i / n * (n + 1) + i % n);
            mesh.triangles.extend(quads.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]));
        }
        mesh
    }

    fn crossing(mesh: &TriMesh) -> usize {
        self_intersecting(mesh).into_iter().filter(|face| *face).count()
    }

    /// The mesh, and how far the farthest of its vertices went.
    fn untangled(mesh: &TriMesh, deepest: f64) -> (TriMesh, f64) {
        let mut simplifier = Simplifier::new(mesh, &vec![1.0; mesh.triangles.len()], 0.0);
        let start = simplifier.positions.clone();
        simplifier.resolve_intersections(deepest);
        let ways = start.iter().zip(&simplifier.positions).map(|(a, b)| a.distance(*b));
        (simplifier.mesh(), ways.fold(0.0, f64::max))
    }

    #[test]
    fn shells_that_cross_a_little_are_taken_apart() {
        let ripple = |x: f32, y: f32| 0.0036 + 0.004 * libm::sinf(20.0 * x) * libm::cosf(17.0 * y);
        let mesh = sheets(12, [|_, _| 0.0, ripple]);
        assert!((40..110).contains(&crossing(&mesh)));
        let (out, farthest) = untangled(&mesh, 0.1);
        assert_eq!(crossing(&out), 0);
        assert!(farthest < 0.01, "{farthest}");
    }

    #[test]
    fn what_passes_deep_or_not_at_all_stays() {
        let steep = sheets(4, [|_, _| 0.0, |x, _| 2.0 * (x - 0.45)]);
        assert!(crossing(&steep) > 0);
        assert_eq!(untangled(&steep, 0.1).1, 0.0);
        let apart = sheets(4, [|_, _| 0.0, |_, _| 0.1]);
        assert_eq!(untangled(&apart, 0.1).1, 0.0);
    }
}
