//! Geometry that several stages need: nearest points and rays, intersections, connectivity, sampling, random numbers.

mod bounding_sphere;
mod bvh;
mod disjoint_sets;
mod equal;
mod face_tree;
mod intersection;
mod kd_tree;
mod random;
mod sampling;
mod topology;

pub use bounding_sphere::BoundingSphere;
pub use bvh::{Bvh, Hit, barycentric, closest_point};
pub(crate) use disjoint_sets::DisjointSets;
pub(crate) use equal::{first_equal, position_bits};
pub(crate) use face_tree::{Box3, FaceTree};
pub use intersection::self_intersecting;
pub(crate) use intersection::{intersect, intersecting_pairs};
pub(crate) use kd_tree::KdTree;
pub use random::Random;
pub use sampling::fibonacci_directions;
pub use topology::{EdgeCounts, Topology};
