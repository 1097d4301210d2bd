//! Fewer triangles of a source that is only looked at.

use std::collections::BTreeMap;

use glam::Vec3;
use meshopt::{SimplifyOptions, VertexDataAdapter, generate_vertex_remap, simplify};
use simpliguard::geometry::vertex_components;

/// Largest error of the first round of decimation, as a fraction of the radius of the scene.
const FIRST_ERROR: f64 = 2e-4;
/// The errors of one round after another are this many times as large. That of the last is about a pixel of the view.
const ERROR_STEP: f64 = 1.5;
/// Rounds that keep seams of attributes. As many follow that do not.
const ROUNDS: usize = 8;

/// Least area of a connected part, as a fraction of what it had. A round that leaves less passes over the part: a leaf or a
/// bar is soon collapsed to nothing, because the error is a mean over areas.
const LEAST_AREA: f32 = 0.5;

const KEEPS_SEAMS: SimplifyOptions = SimplifyOptions::ErrorAbsolute;
const DROPS_SEAMS: SimplifyOptions = KEEPS_SEAMS.union(SimplifyOptions::Permissive);

/// Triangles of many primitives, which become fewer round by round. A round has one error for the whole scene, so that what
/// is large and plain keeps its shape as well as what is small and dense.
pub(super) struct Decimation {
    primitives: BTreeMap<(usize, usize), Primitive>,
    radius: f64,
    round: usize,
}

/// A primitive that is decimated.
pub(super) struct Primitive {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
    /// How often the scene shows it.
    times: usize,
    /// Lengths in the scene of a length of one in the primitive.
    scale: f64,
    /// The connected part of each vertex.
    parts: Vec<u32>,
    /// The area that each part had.
    areas: Vec<f32>,
}

impl Decimation {
    /// Primitives by mesh and index, in a scene of some radius.
    pub(super) fn new(primitives: BTreeMap<(usize, usize), Primitive>, radius: f64) -> Self {
        Self { primitives, radius, round: 0 }
    }

    /// The triangles of a primitive, as indices of its vertices. `None` if it has all of its own.
    pub(super) fn indices(&self, mesh: usize, primitive: usize) -> Option<&[u32]> {
        let decimated = self.primitives.get(&(mesh, primitive)).filter(|_| self.round > 0);
        decimated.map(|primitive| primitive.indices.as_slice())
    }

    /// Decimates until the scene has at most so many triangles, or until the error would show.
    pub(super) fn reduce_to(&mut self, triangles: usize) {
        while self.triangles() > triangles && self.round < 2 * ROUNDS {
            let error = self.radius * FIRST_ERROR * ERROR_STEP.powi((self.round % ROUNDS) as i32);
            let options = if self.round < ROUNDS { KEEPS_SEAMS } else { DROPS_SEAMS };
            self.primitives.values_mut().for_each(|primitive| primitive.collapse(error, options));
            self.round += 1;
        }
    }

    fn triangles(&self) -> usize {
        self.primitives.values().map(|primitive| primitive.times * primitive.indices.len() / 3).sum()
    }
}

impl Primitive {
    /// A primitive that is shown so many times, with lengths in the scene so many times as large as its own. `None` if an index
    /// is too large.
    pub(super) fn new(positions: Vec<[f32; 3]>, mut indices: Vec<u32>, times: usize, scale: f64) -> Option<Self> {
        indices.truncate(indices.len() / 3 * 3);
        indices.iter().all(|&i| (i as usize) < positions.len()).then_some(())?;
        let (count, welded) = generate_vertex_remap(&positions, None);
        let triangles = indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|v| welded[v as usize]));
        let components = vertex_components(count, triangles);
        let parts = welded.iter().map(|&v| components[v as usize]).collect();
        let mut primitive = Self { positions, indices, times, scale, parts, areas: Vec::new() };
        primitive.areas = primitive.areas_of(&primitive.indices);
        Some(primitive)
    }

    /// Twice the area of each part in a set of triangles.
    fn areas_of(&self, indices: &[u32]) -> Vec<f32> {
        let mut areas = vec![0.0; self.positions.len()];
        for triangle in indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|k| Vec3::from(self.positions[triangle[k] as usize]));
            areas[self.parts[triangle[0] as usize] as usize] += (b - a).cross(c - a).length();
        }
        areas
    }

    /// Collapses edges within an error in lengths of the scene.
    fn collapse(&mut self, error: f64, options: SimplifyOptions) {
        let bytes: Vec<u8> = self.positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let Ok(vertices) = VertexDataAdapter::new(&bytes, 12, 0) else { return };
        let collapsed = simplify(&self.indices, &vertices, 0, (error / self.scale) as f32, options, None);
        let areas = self.areas_of(&collapsed);
        let is_passed_over = |triangle: &&[u32]| {
            let part = self.parts[triangle[0] as usize] as usize;
            areas[part] <= LEAST_AREA * self.areas[part]
        };
        let changed = collapsed.chunks_exact(3).filter(|triangle| !is_passed_over(triangle));
        let unchanged = self.indices.chunks_exact(3).filter(is_passed_over);
        self.indices = changed.chain(unchanged).flatten().copied().collect();
    }
}

/// The vertices that indices use, in the order of their first use, and the indices into these.
pub(super) fn compact(indices: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut kept, mut new) = (Vec::new(), BTreeMap::new());
    let renumber = |&old: &u32| {
        *new.entry(old).or_insert_with(|| {
            kept.push(old);
            kept.len() as u32 - 1
        })
    };
    let indices = indices.iter().map(renumber).collect();
    (kept, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hilly square of `n` x `n` cells with sides of 1, or smaller in the scene.
    fn grid(n: u32, height: f32, scale: f64) -> Primitive {
        let side = n + 1;
        let position = |i: u32| {
            let (x, y) = ((i % side) as f32 / n as f32, (i / side) as f32 / n as f32);
            [x, y, height * (9.0 * x).sin() * (9.0 * y).sin()]
        };
        let cell = |i: u32| {
            let corner = i / n * side + i % n;
            [corner, corner + 1, corner + side, corner + 1, corner + side + 1, corner + side]
        };
        let (positions, indices) = ((0..side * side).map(position).collect(), (0..n * n).flat_map(cell).collect());
        Primitive::new(positions, indices, 1, scale).expect("indices of vertices")
    }

    fn triangles(decimation: &Decimation, mesh: usize, primitive: usize) -> usize {
        decimation.indices(mesh, primitive).map_or(0, |indices| indices.len() / 3)
    }

    #[test]
    fn a_wall_of_two_triangles_stays_beside_a_dense_relief() {
        let wall = grid(1, 0.0, 1.0).indices;
        let primitives = [((0, 0), grid(1, 0.0, 1.0)), ((0, 1), grid(60, 0.01, 1.0))];
        let mut decimation = Decimation::new(primitives.into(), 1.0);
        decimation.reduce_to(400);
        assert_eq!(decimation.indices(0, 0), Some(wall.as_slice()));
        assert!((1..400).contains(&triangles(&decimation, 0, 1)));
    }

    #[test]
    fn what_the_scene_shows_small_has_fewer_triangles() {
        let primitives = [((0, 0), grid(60, 0.1, 1.0)), ((1, 0), grid(60, 0.1, 0.1))];
        let mut decimation = Decimation::new(primitives.into(), 1.0);
        decimation.reduce_to(6_000);
        let [large, small] = [0, 1].map(|mesh| triangles(&decimation, mesh, 0));
        assert!(3 * small < large, "{small} {large}");
    }

    #[test]
    fn leaves_stay_and_nothing_is_decimated_beyond_what_shows() {
        let primitives = [((0, 0), grid(60, 0.3, 1.0)), ((0, 1), grid(3, 0.0, 2e-3))];
        let mut decimation = Decimation::new(primitives.into(), 1.0);
        decimation.reduce_to(0);
        assert!(triangles(&decimation, 0, 0) > 30 && triangles(&decimation, 0, 1) > 1);
        assert!(Primitive::new(vec![[0.0; 3]; 3], vec![0, 1, 3], 1, 1.0).is_none());
    }

    #[test]
    fn vertices_are_numbered_anew_by_first_use() {
        assert_eq!(compact(&[7, 3, 7, 9]), (vec![7, 3, 9], vec![0, 1, 0, 2]));
    }
}
