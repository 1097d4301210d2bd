//! Geometry for every stage: nearest points and rays, intersections, connectivity, sampling, random numbers.

mod bounding_sphere;
mod bvh;
mod connected_components;
mod equal;
mod face_tree;
mod half_edges;
mod intersection;
mod kd_tree;
mod random;
mod sampling;
pub(crate) mod self_intersection;
mod topology;
mod triangle;
mod vertex_neighbours;

pub use bounding_sphere::BoundingSphere;
pub use bvh::{Bvh, Hit};
pub(crate) use connected_components::DisjointSets;
pub use connected_components::{face_components, group_by_component, vertex_components};
pub(crate) use equal::{first_coincident, first_equal, position_bits};
pub(crate) use face_tree::{Box3, FaceTree};
pub(crate) use half_edges::sorted_half_edges;
pub use intersection::self_intersecting;
pub(crate) use intersection::{intersect, intersecting_pairs};
pub(crate) use kd_tree::KdTree;
pub use random::Random;
pub use sampling::fibonacci_directions;
pub use topology::{EdgeCounts, Topology};
pub(crate) use triangle::{area_vector, clamped_barycentric, doubled_area};
pub use triangle::{barycentric, closest_point};
pub(crate) use vertex_neighbours::vertex_neighbours;
