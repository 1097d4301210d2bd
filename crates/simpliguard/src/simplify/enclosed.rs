//! Visibility of faces from their own side (section 3.2 of the paper): rays start at points of a face and run through its
//! hemisphere; a face is invisible if none of its rays escapes.

use glam::Vec3;
use rayon::prelude::*;

use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::{BoundingSphere, Bvh, Random, fibonacci_directions};

/// Barycentric coordinates of the points of a face from which rays start.
const POINTS: [[f32; 3]; 4] = [[0.34, 0.33, 0.33], [0.7, 0.15, 0.15], [0.15, 0.7, 0.15], [0.15, 0.15, 0.7]];
/// Directions of rays over the whole sphere.
const DIRECTIONS: usize = 96;
/// Faces that are tested one after the other.
const FACES_IN_A_RUN: usize = 64;

/// Keeps those `faces` of which no ray escapes the mesh: `H = 0` in the paper.
///
/// If `two_sided`, rays start in both hemispheres, and both sides of a face stop a ray. Otherwise back faces let rays
/// pass, because a camera far away sees through them.
pub(super) fn keep_enclosed(
    faces: &mut [bool],
    mesh: &TriMesh,
    sphere: &BoundingSphere,
    two_sided: bool,
    cancellation: &Cancellation,
) {
    let (bvh, directions) = (Bvh::new(&mesh.positions, &mesh.triangles), fibonacci_directions(DIRECTIONS));
    let rays = Rays { mesh, bvh, directions, radius: sphere.radius, two_sided };
    let runs = faces.par_chunks_mut(FACES_IN_A_RUN).enumerate().take_any_while(|_| !cancellation.is_cancelled());
    runs.for_each(|(run, faces)| {
        let mut fates = Fates { occluders: [None; DIRECTIONS], escaped: 0 };
        for (i, face) in faces.iter_mut().enumerate() {
            *face = *face && !rays.escape_from(run * FACES_IN_A_RUN + i, &mut fates);
        }
    });
}

/// The rays that start at a mesh.
struct Rays<'a> {
    mesh: &'a TriMesh,
    bvh: Bvh,
    directions: Vec<Vec3>,
    /// Radius of the mesh.
    radius: f32,
    two_sided: bool,
}

/// How the rays of a run of faces fared last. Those of the next face mostly fare alike, so this is tried first.
struct Fates {
    /// What stopped a ray of each direction.
    occluders: [Option<u32>; DIRECTIONS],
    /// The direction in which a ray escaped.
    escaped: usize,
}

impl Rays<'_> {
    fn escape_from(&self, t: usize, fates: &mut Fates) -> bool {
        let [a, b, c] = self.mesh.corners(t);
        let n = self.mesh.area_vector(t).normalize_or_zero();
        POINTS.iter().any(|[u, v, w]| {
            let p = a * *u + b * *v + c * *w;
            self.escape_into(p, n, fates) || (self.two_sided && self.escape_into(p, -n, fates))
        })
    }

    /// True if a ray from `p` into the hemisphere of `n` escapes.
    fn escape_into(&self, p: Vec3, n: Vec3, fates: &mut Fates) -> bool {
        let from = p + n * self.radius * 1e-4;
        let mut escapes = |i: usize| self.directions[i].dot(n) > 0.05 && self.escapes(from, i, &mut fates.occluders[i]);
        let escaped = Some(fates.escaped).filter(|&i| escapes(i)).or_else(|| (0..DIRECTIONS).find(|&i| escapes(i)));
        fates.escaped = escaped.unwrap_or(fates.escaped);
        escaped.is_some()
    }

    /// True if the ray of a direction escapes. `occluder` is what stopped the last one.
    fn escapes(&self, from: Vec3, direction: usize, occluder: &mut Option<u32>) -> bool {
        let (direction, beyond) = (self.directions[direction], 4.0 * self.radius);
        let stops = |t: u32| self.two_sided || self.mesh.area_vector(t as usize).dot(direction) > 0.0;
        if occluder.is_some_and(|t| self.bvh.is_occluder(t, from, direction, beyond) && stops(t)) {
            return false;
        }
        let found = self.bvh.occluder_where(from, direction, beyond, stops);
        *occluder = found.or(*occluder);
        found.is_none()
    }
}

/// Finds the faces of a mesh in the unit sphere from whose vertices no ray leaves, of so many random ones from each vertex
/// over the hemisphere of its normal: the paper's own test, `H = 0`.
pub(super) fn enclosed_by_random_rays(mesh: &TriMesh, rays: u32, cancellation: &Cancellation) -> Vec<bool> {
    const LIFT: f32 = 1e-4;
    const BEYOND: f32 = 4.0;
    let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
    let normals = mesh.vertex_normals();
    let sees_out = |v: usize| {
        let (normal, mut random) = (normals[v], Random::new(v as u64));
        let from = mesh.positions[v] + normal * LIFT;
        (0..rays).any(|_| {
            let direction = random.rotation() * Vec3::Z;
            let direction = if direction.dot(normal) < 0.0 { -direction } else { direction };
            !bvh.occluded(from, direction, BEYOND)
        })
    };
    let seen: Vec<bool> =
        (0..mesh.positions.len()).into_par_iter().map(|v| cancellation.is_cancelled() || sees_out(v)).collect();
    mesh.triangles.iter().map(|triangle| triangle.iter().all(|&v| !seen[v as usize])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::visibility::tests::nested;

    #[test]
    fn rays_do_not_leave_a_closed_shell() {
        let mesh = nested();
        let sphere = BoundingSphere::around(&mesh.positions);
        let mut faces = [true, true, true, false, true, true, true, true];
        keep_enclosed(&mut faces, &mesh, &sphere, false, &Cancellation::default());
        assert_eq!(faces, [true, true, true, false, false, false, false, false]);
    }

    #[test]
    fn random_rays_do_not_leave_a_closed_shell_either() {
        let mesh = nested();
        let radius = BoundingSphere::around(&mesh.positions).radius;
        let unit = TriMesh { positions: mesh.positions.iter().map(|p| *p / radius).collect(), ..mesh };
        let enclosed = |rays| enclosed_by_random_rays(&unit, rays, &Cancellation::default());
        assert_eq!(enclosed(64), [true, true, true, true, false, false, false, false]);
        assert_eq!(enclosed(0), [true; 8]);
    }

    #[test]
    fn rays_leave_a_room_through_the_backs_of_its_walls() {
        let mut room = nested();
        room.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let sphere = BoundingSphere::around(&room.positions);
        let enclosed = |two_sided: bool| {
            let mut faces = [true; 8];
            keep_enclosed(&mut faces, &room, &sphere, two_sided, &Cancellation::default());
            faces
        };
        assert_eq!(enclosed(false), [false; 8]);
        assert_eq!(enclosed(true), [true, true, true, true, false, false, false, false]);
    }
}
