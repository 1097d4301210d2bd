//! The seam along which two charts are joined that meet along their whole boundary.
//!
//! Two charts that form a closed surface or a tube cannot be joined along their whole common boundary and still be laid
//! flat. They can be joined along a piece of it, as the halves of a shell open on their hinge; the rest stays cut.

use super::chart::Chart;
use super::half_edge_mesh::{HalfEdgeMesh, NO_NEIGHBOUR};

/// Fraction of a closed common boundary along which two charts are joined.
const HINGE: f64 = 0.25;

/// A half-edge on the boundary of a chart.
struct BorderEdge {
    half_edge: u32,
    /// True if the other chart lies on its other side.
    shared: bool,
    length: f64,
    /// One minus the cosine of the angle between the normals of both sides.
    bend: f64,
}

/// The half-edges, of both sides and in rising order, along which the union of `a` and `b` stays cut, so that both are
/// joined along one path. `None` if the charts do not touch.
pub(super) fn cuts(mesh: &HalfEdgeMesh, a: &Chart, b: &Chart) -> Option<Vec<u32>> {
    let border = border(mesh, a, b)?;
    let welded = match border.iter().position(|edge| !edge.shared) {
        Some(first) => longest_run(&border, first)?,
        None => hinge(&border),
    };
    let cut = (0..border.len()).filter(|&i| border[i].shared && !welded.contains(&i)).map(|i| border[i].half_edge);
    let mut cuts: Vec<u32> = cut.flat_map(|h| [h, mesh.opposite[h as usize]]).collect();
    cuts.sort_unstable();
    Some(cuts)
}

/// The boundary of `a` in order; `None` if it is not a disc.
fn border(mesh: &HalfEdgeMesh, a: &Chart, b: &Chart) -> Option<Vec<BorderEdge>> {
    let boundary = a.boundary.as_ref()?;
    let mut leaving = vec![NO_NEIGHBOUR; a.vertices];
    for (corners, &f) in a.corners.iter().zip(&a.faces) {
        for k in 0..3 {
            if a.is_open(mesh, 3 * f + k as u32) {
                leaving[corners[k] as usize] = 3 * f + k as u32;
            }
        }
    }
    let edge = |&v: &u32| {
        let half_edge = leaving[v as usize];
        let (face, other) = (half_edge as usize / 3, mesh.opposite[half_edge as usize]);
        let shared = other != NO_NEIGHBOUR && b.faces.binary_search(&(other / 3)).is_ok();
        let bend = if shared { 1.0 - mesh.normal[face].dot(mesh.normal[other as usize / 3]) } else { 0.0 };
        BorderEdge { half_edge, shared, length: mesh.length[half_edge as usize], bend }
    };
    Some(boundary.iter().map(edge).collect())
}

/// The longest run of shared edges of a boundary whose edge at `first` is not shared.
fn longest_run(border: &[BorderEdge], first: usize) -> Option<Vec<usize>> {
    let mut runs: Vec<Vec<usize>> = vec![Vec::new()];
    for i in (0..border.len()).map(|i| (first + i) % border.len()) {
        match (border[i].shared, runs.last_mut()) {
            (true, Some(run)) => run.push(i),
            _ => runs.push(Vec::new()),
        }
    }
    let length = |run: &[usize]| run.iter().map(|&i| border[i].length).sum::<f64>();
    let longest = runs.into_iter().reduce(|a, b| if length(&b) > length(&a) { b } else { a });
    longest.filter(|run| !run.is_empty())
}

/// The run along which the surface bends least, of all runs of up to [`HINGE`] of a boundary and at least one edge.
fn hinge(border: &[BorderEdge]) -> Vec<usize> {
    let most = HINGE * border.iter().map(|edge| edge.length).sum::<f64>();
    let from = |start: usize| {
        let (mut run, mut length, mut bend) = (Vec::new(), 0.0, 0.0);
        for i in (0..border.len()).map(|i| (start + i) % border.len()) {
            if !run.is_empty() && length + border[i].length > most {
                break;
            }
            run.push(i);
            length += border[i].length;
            bend += border[i].length * border[i].bend;
        }
        (bend / length.max(f64::MIN_POSITIVE), run)
    };
    let runs = (0..border.len()).map(from);
    runs.reduce(|a, b| if b.0 < a.0 { b } else { a }).map_or_else(Vec::new, |(_, run)| run)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{cube, cylinder};
    use super::*;

    fn joined(mesh: &HalfEdgeMesh, a: Vec<u32>, b: Vec<u32>) -> Chart {
        let [a, b] = [a, b].map(|faces| Chart::new(mesh, faces));
        let cuts = cuts(mesh, &a, &b).expect("they touch");
        let mut faces = [a.faces, b.faces].concat();
        faces.sort_unstable();
        Chart::with_cuts(mesh, faces, cuts)
    }

    #[test]
    fn two_halves_of_a_cube_open_on_a_hinge() {
        let mesh = HalfEdgeMesh::new(&cube(), None);
        let union = joined(&mesh, (0..6).collect(), (6..12).collect());
        // Eight edges lie between the halves; a quarter of them is welded, and two triangles share each cut.
        assert_eq!((union.cuts.len(), union.boundary.map(|b| b.len())), (12, Some(12)));
    }

    #[test]
    fn two_halves_of_a_tube_are_joined_along_one_of_two_seams() {
        let mesh = HalfEdgeMesh::new(&cylinder(24), None);
        let union = joined(&mesh, (0..24).collect(), (24..48).collect());
        assert!(union.boundary.is_some());
        // The other seam is one side of two triangles, cut from both.
        assert_eq!(union.cuts.len(), 2);
    }
}
