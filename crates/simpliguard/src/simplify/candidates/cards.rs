//! Foliage: thousands of small flat components become a few hundred cards, after billboard clouds (Décoret et al.
//! 2003).
//!
//! An opaque low-poly surface around a crown of leaves is a blob. Instead, neighbouring leaves are grouped: the crown
//! is halved at medians until there are enough groups. Each group is replaced by the rectangle in its plane of least
//! extent. The texture of the rectangle shows the group along the plane's normal, cut out by alpha. The rest of the
//! source, such as the trunk, collapses as usual.

use glam::Vec3;

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
/// Largest thickness of a leaf, as a fraction of its middle extent.
const LEAF_THICKNESS: f32 = 0.35;
/// Fewest leaves of a foliage.
const LEAVES: usize = 300;
/// Least fraction of the visible pixels that leaves cover.
const LEAF_PIXELS: f64 = 0.25;
/// Fraction of the budget for the rest of the source.
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
        let is_leaf =
            |component: &Vec<u32>| is_leaf(&corners(&mesh, component), opacity(component) < TWIG_OPACITY, radius);
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
        let mut mesh = self.trunk(inputs, params, (f64::from(budget) * TRUNK) as u32);
        let mut cards = Cards {
            group: vec![NO_CARD; mesh.triangles.len()],
            source_group: vec![NO_CARD; inputs.model.surface.triangles.len()],
            reach: Vec::new(),
        };
        let centres: Vec<(Vec3, u32)> = self.leaves.iter().zip(0..).map(|(leaf, i)| (self.centre(leaf), i)).collect();
        let groups = halve(centres, (budget as usize - mesh.triangles.len()) / 2);
        for (group, leaves) in groups.iter().enumerate() {
            let triangles: Vec<u32> = leaves.iter().flat_map(|&l| &self.leaves[l as usize]).copied().collect();
            for &t in &triangles {
                cards.source_group[self.source[t as usize] as usize] = group as u32;
            }
            let around = OrientedBox::around(&corners(&self.mesh, &triangles));
            cards.reach.push(around.add_rectangle(&mut mesh));
            cards.group.extend([group as u32; 2]);
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

    fn centre(&self, leaf: &[u32]) -> Vec3 {
        let points = corners(&self.mesh, leaf);
        points.iter().sum::<Vec3>() / points.len() as f32
    }
}

/// True if a component with these corners is a leaf: small and flat, or small and cut out. `radius` is that of the bounding
/// sphere of the source.
fn is_leaf(corners: &[Vec3], is_cut_out: bool, radius: f32) -> bool {
    let (low, high) = bounds(corners);
    let size = low.distance(high);
    if is_cut_out {
        return size <= TWIG_SIZE * radius;
    }
    let half = OrientedBox::around(corners).half;
    size <= LEAF_SIZE * radius && half.z <= LEAF_THICKNESS * half.y
}

fn corners(mesh: &TriMesh, triangles: &[u32]) -> Vec<Vec3> {
    triangles.iter().flat_map(|&t| mesh.corners(t as usize)).collect()
}

/// Groups points: halves the largest group at the median of its longest extent until there are `n` groups. The number
/// beside a point identifies it in the result.
fn halve(points: Vec<(Vec3, u32)>, n: usize) -> Vec<Vec<u32>> {
    let mut groups = vec![points];
    while groups.len() < n {
        let Some(i) = (0..groups.len()).max_by_key(|&i| (groups[i].len(), std::cmp::Reverse(i))) else { break };
        if groups[i].len() < 2 {
            break;
        }
        let mut group = groups.swap_remove(i);
        let positions: Vec<Vec3> = group.iter().map(|p| p.0).collect();
        let (low, high) = bounds(&positions);
        let axis = (high - low).max_position();
        group.sort_by(|a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
        let upper = group.split_off(group.len() / 2);
        groups.extend([group, upper]);
    }
    groups.into_iter().filter(|g| !g.is_empty()).map(|g| g.into_iter().map(|p| p.1).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::oriented_box::tests::slab;

    #[test]
    fn leaves_are_small_and_flat_or_small_and_cut_out() {
        // The diagonal of the slab's bounding box is between 4.6 and 6.9.
        let is_leaf_of = |is_cut_out, radius| is_leaf(&slab(), is_cut_out, radius);
        assert!(is_leaf_of(false, 30.0) && is_leaf_of(true, 30.0));
        assert!(!is_leaf_of(false, 12.0) && is_leaf_of(true, 12.0));
        assert!(!is_leaf_of(true, 5.0));
        let cube: Vec<Vec3> = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
        assert!(!is_leaf(&cube, false, 30.0) && is_leaf(&cube, true, 30.0));
    }

    #[test]
    fn halving_gives_groups_of_neighbours() {
        let points = (0..8).map(|i| (Vec3::new(i as f32, 0.0, 0.0), i)).collect();
        let mut groups = halve(points, 4);
        groups.sort();
        assert_eq!(groups, [[0, 1], [2, 3], [4, 5], [6, 7]]);
    }
}
