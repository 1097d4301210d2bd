//! Which faces anything can see.
//!
//! From outside: an identity buffer from many directions tells which faces of a input mesh are seen and how large they
//! appear. From the surface (paper 3.2): rays from points on a face through its hemisphere; a face none of whose rays
//! escapes cannot be seen.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::{BoundingSphere, Bvh, fibonacci_directions};
use crate::render::{Camera, EMPTY_PIXEL, Raster, Rect};

/// Side of the identity buffer in pixels.
const SIZE: usize = 640;
/// Directions that decide on the density of texels.
const DENSITY_DIRECTIONS: usize = 36;
/// Density of what hardly anything sees, and of what everything sees.
const LEAST_DENSITY: f32 = 0.5;
const LARGEST_DENSITY: f32 = 1.5;
/// Points on a face and rays from each.
const POINTS: [[f32; 3]; 4] = [[0.34, 0.33, 0.33], [0.7, 0.15, 0.15], [0.15, 0.7, 0.15], [0.15, 0.15, 0.7]];
const RAYS: usize = 48;

/// Pixels that each face covers over all of `directions`. Back faces count where `double_sided(t)`.
pub(super) fn visible_pixels(
    mesh: &TriMesh,
    sphere: &BoundingSphere,
    directions: usize,
    double_sided: &(impl Fn(usize) -> bool + Sync),
    cancellation: &Cancellation,
) -> Vec<u32> {
    // Not the lattice the views use, so that the two do not share their blind spots.
    let turn = glam::Quat::from_xyzw(0.18, 0.37, 0.26, 0.87).normalize();
    let directions = fibonacci_directions(directions);
    let count = |(mut raster, mut pixels): (Raster, Vec<u32>), direction: &Vec3| {
        let camera = Camera::orbit(sphere, (turn * *direction).normalize(), 0.6, 1.0);
        let clip: Vec<Vec4> = camera.project(&mesh.positions);
        let rect = Rect::around(&clip, SIZE, 0);
        raster.clear(rect);
        raster.draw(&clip, &mesh.triangles, double_sided);
        for y in rect.rows() {
            for &id in &raster.ids[y * SIZE + rect.x0..y * SIZE + rect.x1.max(rect.x0)] {
                if id != EMPTY_PIXEL {
                    pixels[id as usize] += 1;
                }
            }
        }
        (raster, pixels)
    };
    let empty = || vec![0u32; mesh.triangles.len()];
    let wanted = directions.par_iter().take_any_while(|_| !cancellation.is_cancelled());
    wanted.fold(|| (Raster::new(SIZE), empty()), count).map(|(_, pixels)| pixels).reduce(empty, |mut a, b| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    })
}

/// How densely texels are to lie on each face, relative to the mean: as the square root of the part of its area that
/// cameras around the mesh see, each face with its neighbours.
pub fn texel_density(
    mesh: &TriMesh,
    sphere: &BoundingSphere,
    double_sided: bool,
    cancellation: &Cancellation,
) -> Vec<f32> {
    let pixels = visible_pixels(mesh, sphere, DENSITY_DIRECTIONS, &|_| double_sided, cancellation);
    let weights = face_weights(mesh, &pixels, 1.0);
    let density = |(t, weight): (usize, f64)| {
        let area = 0.5 * f64::from(mesh.area_vector(t).length());
        let density = if area > 0.0 { (weight / area).sqrt() as f32 } else { 1.0 };
        density.clamp(LEAST_DENSITY, LARGEST_DENSITY)
    };
    weights.into_iter().enumerate().map(density).collect()
}

/// Area of each face, scaled by the number of pixels that see its surroundings per area, relative to the mean.
pub(super) fn face_weights(mesh: &TriMesh, pixels: &[u32], visible: f64) -> Vec<f64> {
    let areas: Vec<f64> = (0..mesh.triangles.len()).map(|t| 0.5 * f64::from(mesh.area_vector(t).length())).collect();
    let area: f64 = areas.iter().sum();
    let total: f64 = pixels.iter().map(|&n| f64::from(n)).sum();
    if total == 0.0 || area == 0.0 {
        return areas;
    }
    // Pixels and area around each vertex: a face between two pixels is not weightless.
    let mut around = vec![(0.0, 0.0); mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for &v in triangle {
            around[v as usize].0 += f64::from(pixels[t]) / total;
            around[v as usize].1 += areas[t] / area;
        }
    }
    let density = |v: u32| around[v as usize].0 / around[v as usize].1.max(1e-12);
    let mean = |t: &[u32; 3]| t.iter().map(|&v| density(v)).sum::<f64>() / 3.0;
    mesh.triangles.iter().zip(&areas).map(|(t, &a)| a * ((1.0 - visible) + visible * mean(t))).collect()
}

/// Grows a set of faces by those that share a vertex with it, `rings` times.
pub(super) fn grow(mesh: &TriMesh, faces: &mut [bool], rings: usize) {
    for _ in 0..rings {
        let mut touched = vec![false; mesh.positions.len()];
        for (triangle, _) in mesh.triangles.iter().zip(&*faces).filter(|(_, seen)| **seen) {
            triangle.iter().for_each(|&v| touched[v as usize] = true);
        }
        for (triangle, face) in mesh.triangles.iter().zip(&mut *faces) {
            *face |= triangle.iter().any(|&v| touched[v as usize]);
        }
    }
}

/// Keeps those `faces` none of whose rays escapes the mesh: `H = 0` in the paper. With `two_sided` both hemispheres count,
/// and both sides of a face stop a ray; without, whoever looks along a ray from afar sees through back faces.
pub(super) fn keep_enclosed(
    faces: &mut [bool],
    mesh: &TriMesh,
    sphere: &BoundingSphere,
    two_sided: bool,
    cancellation: &Cancellation,
) {
    let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
    let directions = fibonacci_directions(2 * RAYS);
    let lift = sphere.radius * 1e-4;
    let escapes = |p: Vec3, n: Vec3| {
        let stopped = |d: Vec3| {
            let stops = |t: u32| two_sided || mesh.area_vector(t as usize).dot(d) > 0.0;
            bvh.occluded_where(p + n * lift, d, 4.0 * sphere.radius, stops)
        };
        directions.iter().filter(|d| d.dot(n) > 0.05).any(|&d| !stopped(d))
    };
    let sees_out = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        let n = mesh.area_vector(t).normalize_or_zero();
        POINTS.iter().any(|[u, v, w]| {
            let p = a * *u + b * *v + c * *w;
            escapes(p, n) || (two_sided && escapes(p, -n))
        })
    };
    let wanted = faces.par_iter_mut().enumerate().with_min_len(64).take_any_while(|_| !cancellation.is_cancelled());
    wanted.for_each(|(t, face)| *face = *face && !sees_out(t));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit tetrahedron inside one five times as large.
    fn nested() -> TriMesh {
        let corners = [[-1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]].map(Vec3::from);
        let faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        TriMesh {
            positions: corners.iter().copied().chain(corners.iter().map(|c| *c * 5.0)).collect(),
            triangles: faces.iter().copied().chain(faces.map(|f| f.map(|v| v + 4))).collect(),
        }
    }

    #[test]
    fn rays_do_not_leave_a_closed_shell() {
        let mesh = nested();
        let sphere = BoundingSphere::around(&mesh.positions);
        let mut faces = [true, true, true, false, true, true, true, true];
        keep_enclosed(&mut faces, &mesh, &sphere, false, &Cancellation::default());
        assert_eq!(faces, [true, true, true, false, false, false, false, false]);
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

    #[test]
    fn cameras_see_the_outer_shell_alone() {
        let mesh = nested();
        let pixels =
            visible_pixels(&mesh, &BoundingSphere::around(&mesh.positions), 72, &|_| false, &Cancellation::default());
        assert!(pixels[..4].iter().all(|&n| n == 0) && pixels[4..].iter().all(|&n| n > 0), "{pixels:?}");
    }

    #[test]
    fn hidden_faces_get_fewer_texels() {
        let mesh = nested();
        let density = texel_density(&mesh, &BoundingSphere::around(&mesh.positions), false, &Cancellation::default());
        assert_eq!(density[..4], [LEAST_DENSITY; 4]);
        assert!(density[4..].iter().all(|&d| (0.9..1.2).contains(&d)), "{density:?}");
        let nothing = TriMesh { positions: mesh.positions, triangles: vec![[0, 0, 0]] };
        assert_eq!(
            texel_density(&nothing, &BoundingSphere::around(&[Vec3::ZERO]), true, &Cancellation::default()),
            [1.0]
        );
    }

    #[test]
    fn rings_grow_over_shared_vertices() {
        let mesh = nested();
        let mut seen = [false, false, false, false, true, false, false, false];
        grow(&mesh, &mut seen, 1);
        assert_eq!(seen, [false, false, false, false, true, true, true, true]);
    }
}
