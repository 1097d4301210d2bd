//! Foliage: thousands of small flat components, or of needles, become a few hundred cards, after billboard clouds (Décoret et al.
//! 2003).
//!
//! An opaque low-poly surface around a crown of leaves is a blob. Instead, leaves that lie near one plane are grouped, and
//! each group is replaced by a rectangle in its plane. The texture of the rectangle shows the group along the plane's
//! normal, cut out by alpha. The rest of the source, such as the trunk, collapses as usual.

use glam::Vec3;

use super::leaf_groups::{self, Moments};
use crate::data::{Candidate, Cards, NO_CARD, TriMesh, bounds};
use crate::geometry::{face_components, group_by_component};
use crate::simplify::budgets::simplify_to_budgets;
use crate::simplify::inputs::Inputs;
use crate::simplify::oriented_box::OrientedBox;
use crate::simplify::params::{CollapseParams, SimplifyParams};
use crate::simplify::shape::{Shape, Shortfall};
use crate::simplify::simplify_input::SimplifyInput;
use crate::simplify::visibility::DIRECTIONS;
use crate::simplify::{visibility, weld};

/// Largest extent of a leaf, as a fraction of the radius of the bounding sphere.
const LEAF_SIZE: f32 = 0.25;
/// The same of a cut-out, which may show a twig with its leaves.
const TWIG_SIZE: f32 = 0.6;
/// Largest fraction of a cut-out component that is not cut out.
const TWIG_OPACITY: f32 = 0.85;
/// Least flatness of a leaf, more than that of a tube: petals and blades of grass are bent.
const FLATNESS: f64 = 0.6;
/// Largest extent of a needle, and its least flatness, between those of a ball and of a tube: a card shows tubes that small as
/// well as it shows leaves.
const NEEDLE_SIZE: f32 = 0.15;
const NEEDLE_FLATNESS: f64 = 0.4;
/// Fewest leaves of a foliage.
const LEAVES: usize = 100;
/// Least fraction of the visible pixels that leaves cover.
const LEAF_PIXELS: f64 = 0.5;
/// Fraction of the budget for the rest of the source, or more.
const TRUNK: f64 = 0.3;

/// A source divided into leaves and a trunk, which is all the rest.
struct Foliage {
    mesh: TriMesh,
    /// Triangle of the source for each triangle of `mesh`.
    source: Vec<u32>,
    /// Triangles of each leaf.
    leaves: Vec<Vec<u32>>,
    /// For each triangle, true if it belongs to a leaf.
    is_leaf: Vec<bool>,
    /// Number of pixels that each triangle covers, over all views.
    pixels: Vec<u32>,
}

/// One shape for each budget if the source is foliage, else `None`.
pub(crate) fn shapes(inputs: &Inputs<'_>, params: &SimplifyParams) -> Option<Vec<Shape>> {
    let foliage = Foliage::find(inputs)?;
    Some(params.budgets.iter().map(|&budget| foliage.shape(inputs, params, budget)).collect())
}

impl Foliage {
    /// Finds the leaves of the source; `None` if there are too few of them or if they cover too few pixels.
    fn find(inputs: &Inputs<'_>) -> Option<Self> {
        let opaque = inputs.opaque;
        let (mesh, welded_from) = weld::weld(&opaque.mesh.positions, &opaque.mesh.triangles);
        let components = group_by_component(&face_components(mesh.positions.len(), &mesh.triangles));
        if components.len() < LEAVES {
            return None;
        }
        let radius = inputs.sphere.radius;
        let source: Vec<u32> = welded_from.iter().map(|&t| opaque.source[t as usize]).collect();
        // Whole characters have one material with a cut-out somewhere: what counts is what is cut out of the component.
        let opacity = |component: &[u32]| {
            let area = |t: u32| mesh.area_vector(t as usize).length();
            let opaque: f32 =
                component.iter().map(|&t| area(t) * opaque.opacity[welded_from[t as usize] as usize]).sum();
            opaque / component.iter().map(|&t| area(t)).sum::<f32>().max(f32::MIN_POSITIVE)
        };
        let is_leaf = |component: &Vec<u32>| {
            let triangles: Vec<[Vec3; 3]> = component.iter().map(|&t| mesh.corners(t as usize)).collect();
            is_leaf(&triangles, opacity(component) < TWIG_OPACITY, radius)
        };
        let leaves: Vec<Vec<u32>> = components.into_iter().filter(is_leaf).collect();
        if leaves.len() < LEAVES {
            return None;
        }
        let pixels =
            visibility::visible_pixels(&mesh, &inputs.sphere, DIRECTIONS, &|_| true, inputs.cancellation).covered;
        let mut is_leaf = vec![false; mesh.triangles.len()];
        leaves.iter().flatten().for_each(|&t| is_leaf[t as usize] = true);
        let count = |leaf: bool| {
            pixels
                .iter()
                .zip(&is_leaf)
                .filter(|(_, is_leaf)| **is_leaf == leaf)
                .map(|(&n, _)| f64::from(n))
                .sum::<f64>()
        };
        let (of_leaves, of_trunk) = (count(true), count(false));
        (of_leaves >= LEAF_PIXELS * (of_leaves + of_trunk)).then_some(Self { mesh, source, leaves, is_leaf, pixels })
    }

    /// The trunk, collapsed, and cards for the rest of the budget.
    fn shape(&self, inputs: &Inputs<'_>, params: &SimplifyParams, budget: u32) -> Shape {
        // The trunk also gets what leaves cannot use.
        let unused = budget.saturating_sub(2 * self.leaves.len() as u32);
        let mut mesh = self.trunk(inputs, params, unused.max((f64::from(budget) * TRUNK) as u32));
        let mut cards = Cards {
            group: vec![NO_CARD; mesh.triangles.len()],
            source_group: vec![NO_CARD; inputs.model.surface.triangles.len()],
            reach: Vec::new(),
        };
        let n = (budget as usize - mesh.triangles.len()) / 2;
        let groups = leaf_groups::group(&self.moments(), n, self.leaf_size());
        for (group, number) in groups.iter().zip(0..) {
            let triangles: Vec<u32> = group.leaves.iter().flat_map(|&l| &self.leaves[l as usize]).copied().collect();
            for &t in &triangles {
                cards.source_group[self.source[t as usize] as usize] = number;
            }
            let around = OrientedBox::across(group.normal, group.centre, &corners(&self.mesh, &triangles));
            cards.reach.push(around.add_rectangle(&mut mesh));
            cards.group.extend([number; 2]);
        }
        Shape { cards: Some(cards), ..Shape::unscored(mesh, true, Candidate::Cards, Shortfall::Leaves) }
    }

    /// The trunk, collapsed to `budget` faces. Empty if no collapse meets the budget.
    fn trunk(&self, inputs: &Inputs<'_>, params: &SimplifyParams, budget: u32) -> TriMesh {
        let mesh = weld::cut(&self.mesh.filtered(|t| !self.is_leaf[t]));
        if mesh.triangles.is_empty() {
            return TriMesh::default();
        }
        let pixels: Vec<u32> =
            self.pixels.iter().zip(&self.is_leaf).filter(|(_, leaf)| !**leaf).map(|(&n, _)| n).collect();
        let collapse = CollapseParams { remove_invisible: false, ..params.collapse };
        let params = SimplifyParams { budgets: vec![budget], collapse, ..params.clone() };
        let input = SimplifyInput { mesh, pixels, double_sided: true, is_clear: false };
        let shapes = simplify_to_budgets(inputs, &params, Candidate::Cards, &input);
        shapes.into_iter().map(|s| s.mesh).find(|m| m.triangles.len() <= budget as usize).unwrap_or_default()
    }

    /// Sums over the triangles of each leaf, by how much of them is seen.
    fn moments(&self) -> Vec<Moments> {
        // Leaves that no view shows go with the others.
        let weight = |t: u32| f64::from(self.pixels[t as usize]) + 0.01;
        let of_triangle = |&t: &u32| Moments::of_triangle(self.mesh.corners(t as usize), weight(t));
        self.leaves.iter().map(|leaf| leaf.iter().map(of_triangle).sum()).collect()
    }

    /// The median of the sizes of the leaves.
    fn leaf_size(&self) -> f64 {
        let mut sizes: Vec<f32> = self.leaves.iter().map(|leaf| size(&corners(&self.mesh, leaf))).collect();
        sizes.sort_unstable_by(f32::total_cmp);
        f64::from(sizes[sizes.len() / 2].max(f32::MIN_POSITIVE))
    }
}

/// True if a component is a leaf: small and flat, a needle, or small and cut out. `radius` is that of the bounding sphere of the
/// source.
fn is_leaf(triangles: &[[Vec3; 3]], is_cut_out: bool, radius: f32) -> bool {
    let size = size(triangles.as_flattened());
    if is_cut_out {
        return size <= TWIG_SIZE * radius;
    }
    let least = if size <= NEEDLE_SIZE * radius { NEEDLE_FLATNESS } else { FLATNESS };
    size <= LEAF_SIZE * radius && flatness(triangles) >= least
}

/// How flat triangles are together: 1 in a plane, 1/2 around a tube, 1/3 around a ball.
fn flatness(triangles: &[[Vec3; 3]]) -> f64 {
    let by_area = |&[a, b, c]: &[Vec3; 3]| {
        let area = (b - a).cross(c - a).length();
        Moments::of_triangle([a, b, c], f64::from(area))
    };
    triangles.iter().map(by_area).sum::<Moments>().flatness()
}

/// The diagonal of the bounding box.
fn size(points: &[Vec3]) -> f32 {
    let (low, high) = bounds(points);
    low.distance(high)
}

fn corners(mesh: &TriMesh, triangles: &[u32]) -> Vec<Vec3> {
    triangles.iter().flat_map(|&t| mesh.corners(t as usize)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A long strip of two squares that are bent by an angle at their common side.
    fn blade(bend: f32) -> Vec<[Vec3; 3]> {
        let (sin, cos) = bend.sin_cos();
        let row = |x: f32, z: f32| [Vec3::new(x, 0.0, z), Vec3::new(x, 1.0, z)];
        let [[a, b], [c, d], [e, f]] = [row(-1.0, 0.0), row(0.0, 0.0), row(cos, sin)];
        vec![[a, c, d], [a, d, b], [c, e, f], [c, f, d]]
    }

    #[test]
    fn what_is_bent_a_little_is_flat() {
        // Two equal parts, each turned from the mean by half the angle.
        for (bend, expected) in [(0.0, 1.0), (0.6, 0.3_f64.cos().powi(2)), (std::f32::consts::FRAC_PI_2, 0.5)] {
            let flatness = flatness(&blade(bend));
            assert!((flatness - expected).abs() < 1e-4, "{bend}: {flatness}");
        }
    }

    #[test]
    fn leaves_are_small_and_flat_or_small_and_cut_out() {
        // The diagonal of the bent blade's bounding box is between 2.1 and 2.3, that of the folded one between 1.7 and 1.8.
        let (bent, folded) = (blade(0.6), blade(std::f32::consts::FRAC_PI_2));
        assert!(is_leaf(&bent, false, 10.0) && !is_leaf(&folded, false, 10.0));
        assert!(is_leaf(&bent, true, 10.0) && is_leaf(&folded, true, 10.0));
        assert!(!is_leaf(&bent, false, 8.0) && is_leaf(&bent, true, 8.0));
        assert!(!is_leaf(&bent, true, 3.0));
        // Folded by a right angle, it is a needle in a larger source.
        assert!(!is_leaf(&folded, false, 11.0) && is_leaf(&folded, false, 12.0));
    }
}
