//! The volume inside a surface, on a grid.

use glam::{IVec3, Vec3};
use rayon::prelude::*;
use simpliguard::data::{TriMesh, bounds};

use super::distance::sample;
use super::winding::WindingNumbers;

/// Voxels along the longest side of the source, its padding included.
const VOXELS: f32 = 128.0;
/// Empty space on each side of the source, as a fraction of its longest side.
const PADDING: f32 = 0.02;
/// Winding number above which a point is inside. Its sign does not count, so flipped parts are solid, too.
const INSIDE: f32 = 0.5;
/// Points of the surface that mark the voxels near it.
const SAMPLES: usize = 300_000;

/// A grid of cubic voxels around a source.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    origin: Vec3,
    step: f32,
    size: IVec3,
}

/// The voxels of a grid whose centres are inside.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Occupancy(Vec<bool>);

impl Grid {
    /// The grid around a source; `None` around a point or nothing.
    pub(crate) fn around(source: &TriMesh) -> Option<Self> {
        let (low, high) = bounds(&source.positions);
        let extent = high - low;
        let step = extent.max_element() * (1.0 + 2.0 * PADDING) / VOXELS;
        if !(step.is_normal() && extent.is_finite()) {
            return None;
        }
        let size = (extent / step + 2.0 * PADDING * VOXELS).ceil().as_ivec3().max(IVec3::splat(2));
        Some(Self { origin: 0.5 * (low + high - size.as_vec3() * step), step, size })
    }

    /// The inside of a surface: at half resolution, and at full resolution near the surface and wherever the inside ends.
    pub(crate) fn occupancy(&self, mesh: &TriMesh) -> Occupancy {
        let winding = WindingNumbers::new(mesh);
        let half = Self { step: 2.0 * self.step, size: (self.size + 1) / 2, ..*self };
        let is_inside = |grid: &Self, i: usize| winding.at(grid.centre(grid.place(i))).abs() > INSIDE;
        let coarse: Vec<bool> = (0..half.count()).into_par_iter().map(|i| is_inside(&half, i)).collect();
        let is_near = half.near_surface(mesh);
        let is_border = |i: usize| is_near[i] || half.neighbours(i).any(|n| coarse[n] != coarse[i]);
        let border: Vec<bool> = (0..half.count()).into_par_iter().map(is_border).collect();
        let fine = (0..self.count()).into_par_iter().map(|i| {
            let parent = half.index(self.place(i) / 2);
            if border[parent] { is_inside(self, i) } else { coarse[parent] }
        });
        Occupancy(fine.collect())
    }

    /// The voxels that the surface passes through, and those that share a face with one of them.
    fn near_surface(&self, mesh: &TriMesh) -> Vec<bool> {
        let mut near = vec![false; self.count()];
        for point in sample(mesh, SAMPLES) {
            let place = ((point - self.origin) / self.step).floor().as_ivec3().clamp(IVec3::ZERO, self.size - 1);
            near[self.index(place)] = true;
            for step in [IVec3::X, IVec3::Y, IVec3::Z, IVec3::NEG_X, IVec3::NEG_Y, IVec3::NEG_Z] {
                if self.contains(place + step) {
                    near[self.index(place + step)] = true;
                }
            }
        }
        near
    }

    /// The voxels that touch one, itself included.
    fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> {
        let (grid, place) = (*self, self.place(i));
        let steps = (0..27).map(|k| IVec3::new(k % 3, k / 3 % 3, k / 9) - 1);
        steps.map(move |step| place + step).filter(move |p| grid.contains(*p)).map(move |p| grid.index(p))
    }

    fn contains(&self, place: IVec3) -> bool {
        place.cmpge(IVec3::ZERO).all() && place.cmplt(self.size).all()
    }

    fn count(&self) -> usize {
        self.size.to_array().into_iter().map(|side| side as usize).product()
    }

    fn index(&self, place: IVec3) -> usize {
        ((place.z * self.size.y + place.y) * self.size.x + place.x) as usize
    }

    fn place(&self, i: usize) -> IVec3 {
        let i = i as i32;
        IVec3::new(i % self.size.x, i / self.size.x % self.size.y, i / (self.size.x * self.size.y))
    }

    fn centre(&self, place: IVec3) -> Vec3 {
        self.origin + (place.as_vec3() + 0.5) * self.step
    }
}

impl Occupancy {
    /// Intersection over union of two volumes on one grid; `None` if both are empty.
    pub(crate) fn iou(&self, other: &Self) -> Option<f64> {
        let count = |test: fn(bool, bool) -> bool| self.0.iter().zip(&other.0).filter(|(a, b)| test(**a, **b)).count();
        let either = count(|a, b| a || b);
        (either > 0).then(|| count(|a, b| a && b) as f64 / either as f64)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A closed box.
    pub(crate) fn cuboid(low: Vec3, high: Vec3) -> TriMesh {
        let corner =
            |i: usize| Vec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }));
        let sides: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriMesh { positions: (0..8).map(corner).collect(), triangles }
    }

    #[test]
    fn boxes_shifted_by_half_overlap_by_a_third() {
        let source = cuboid(Vec3::ZERO, Vec3::ONE);
        let shifted = cuboid(Vec3::X * 0.5, Vec3::new(1.5, 1.0, 1.0));
        // The grid ends behind the source's padding, so that it holds 0.52 of the shifted box.
        let grid = Grid::around(&source).expect("a grid");
        let iou = grid.occupancy(&source).iou(&grid.occupancy(&shifted)).expect("volumes");
        assert!((iou - 0.5 / 1.02).abs() < 0.01, "{iou}");
        let both = Grid::around(&cuboid(Vec3::ZERO, Vec3::new(1.5, 1.0, 1.0))).expect("a grid");
        let iou = both.occupancy(&source).iou(&both.occupancy(&shifted)).expect("volumes");
        assert!((iou - 1.0 / 3.0).abs() < 0.01, "{iou}");
    }

    #[test]
    fn a_flipped_box_is_as_solid_and_a_sheet_has_no_inside() {
        let source = cuboid(Vec3::ZERO, Vec3::new(2.0, 1.0, 1.0));
        let mut flipped = source.clone();
        flipped.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let grid = Grid::around(&source).expect("a grid");
        assert_eq!(grid.occupancy(&source).iou(&grid.occupancy(&flipped)), Some(1.0));
        let sheet = TriMesh { triangles: source.triangles[..2].to_vec(), ..source.clone() };
        let grid = Grid::around(&TriMesh { positions: source.positions[..4].to_vec(), ..sheet.clone() });
        assert!(grid.is_some_and(|grid| grid.occupancy(&sheet).iou(&grid.occupancy(&sheet)).is_none()));
        assert!(Grid::around(&TriMesh::default()).is_none());
    }

    #[test]
    fn the_inside_has_the_volume_of_the_box() {
        let source = cuboid(Vec3::ZERO, Vec3::new(1.0, 0.5, 0.25));
        let grid = Grid::around(&source).expect("a grid");
        let inside = grid.occupancy(&source).0.into_iter().filter(|inside| *inside).count();
        let volume = inside as f32 * grid.step.powi(3);
        // Its shortest side is 31 voxels long, or 30.
        assert!((volume / 0.125 - 1.0).abs() < 0.04, "{volume}");
    }
}
