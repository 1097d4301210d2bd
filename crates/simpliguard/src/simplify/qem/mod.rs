//! Edge collapse by quadric error, on a mesh that stays a manifold.
//!
//! An edge may collapse if the link condition holds (Dey et al. 1999), no face flips, no face loses its area and, once
//! self-intersections are watched, no more pairs of faces intersect. If no such edge is left, the test for
//! self-intersections is dropped first, then the test for flips, and at last the smallest components are removed. So a
//! budget is only missed if one component has too many handles.

mod adjacency;
mod collapse;
mod compact;
mod components;
mod contact;
mod follow_poses;
mod link_condition;
mod placement;
mod posed_quadrics;
mod quadric;
mod queue;
mod resolve_intersections;
mod self_intersection_guard;
mod simplifier;
#[cfg(test)]
mod tests;
mod vertex_quadrics;

pub(super) use quadric::Quadric;
pub(super) use simplifier::Simplifier;
