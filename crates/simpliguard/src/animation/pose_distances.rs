//! Distances between many poses of the same points.

use glam::Vec3;

/// Poses that are compared at once. Their sums do not wait for each other, and each stays in the order of the points.
const LANES: usize = 16;

/// Points in many poses, stored so that one pose is compared with [`LANES`] others at once.
pub(super) struct PoseDistances {
    poses: usize,
    /// For each group of poses and each point, the coordinates: all x, all y, all z.
    groups: Vec<Vec<[[f32; LANES]; 3]>>,
}

impl PoseDistances {
    /// Over poses with equally many points.
    pub(super) fn new(poses: &[Vec<Vec3>]) -> Self {
        let group = |poses: &[Vec<Vec3>]| {
            let lane = |point: usize, axis: usize, k: usize| poses.get(k).map_or(0.0, |pose| pose[point][axis]);
            let coordinates = |point| [0, 1, 2].map(|axis| std::array::from_fn(|k| lane(point, axis, k)));
            (0..poses.first().map_or(0, Vec::len)).map(coordinates).collect()
        };
        Self { poses: poses.len(), groups: poses.chunks(LANES).map(group).collect() }
    }

    /// Calls `visit(pose, distance)` for all poses in their order: the sum of squared distances of their points to
    /// those of `to`.
    pub(super) fn each(&self, to: &[Vec3], mut visit: impl FnMut(usize, f64)) {
        for (group, first) in self.groups.iter().zip((0..).step_by(LANES)) {
            let mut sums = [0.0f64; LANES];
            for ([x, y, z], q) in group.iter().zip(to) {
                for k in 0..LANES {
                    let (dx, dy, dz) = (x[k] - q.x, y[k] - q.y, z[k] - q.z);
                    sums[k] += f64::from(dx * dx + dy * dy + dz * dz);
                }
            }
            for (k, sum) in sums.into_iter().enumerate().take(self.poses - first) {
                visit(first + k, sum);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Random;

    #[test]
    fn distances_are_those_of_one_pose_at_a_time() {
        let mut random = Random::new(1);
        let mut pose = || (0..7).map(|_| Vec3::new(random.unit(), random.unit(), random.unit())).collect::<Vec<Vec3>>();
        let poses: Vec<Vec<Vec3>> = (0..LANES + 3).map(|_| pose()).collect();
        let mut found = Vec::new();
        PoseDistances::new(&poses).each(&poses[2], |pose, distance| found.push((pose, distance)));
        let distance = |pose: &Vec<Vec3>| -> f64 {
            pose.iter().zip(&poses[2]).map(|(a, b)| f64::from(a.distance_squared(*b))).sum()
        };
        let expected: Vec<(usize, f64)> = poses.iter().map(distance).enumerate().collect();
        assert_eq!(found, expected);
    }
}
