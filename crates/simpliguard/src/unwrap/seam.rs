//! Where two charts grow together that meet all around.
//!
//! Two charts that make up a closed part, or a tube, cannot be joined along all of their common border and still be laid flat.
//! They can along a piece of it, as the two halves of a shell open on their hinge; the rest stays cut.

use super::chart::Chart;
use super::surface::{NONE, Surface};

/// Part of a common border that closes on itself along which two charts are joined.
const HINGE: f64 = 0.25;

/// A half-edge on the border of a chart.
struct BorderEdge {
    half_edge: u32,
    /// The other chart lies behind it.
    shared: bool,
    length: f64,
    /// One less the cosine of the angle that the surface bends by there.
    bend: f64,
}

/// The half-edges, both sides, along which the union of `a` and `b` stays cut so that they are joined along one path; in rising
/// order. `None` where they do not touch.
pub(super) fn cuts(surface: &Surface, a: &Chart, b: &Chart) -> Option<Vec<u32>> {
    let border = border(surface, a, b)?;
    let welded = match border.iter().position(|edge| !edge.shared) {
        Some(first) => longest_run(&border, first)?,
        None => hinge(&border),
    };
    let cut = (0..border.len()).filter(|&i| border[i].shared && !welded.contains(&i)).map(|i| border[i].half_edge);
    let mut cuts: Vec<u32> = cut.flat_map(|h| [h, surface.opposite[h as usize]]).collect();
    cuts.sort_unstable();
    Some(cuts)
}

/// The border of `a` in order.
fn border(surface: &Surface, a: &Chart, b: &Chart) -> Option<Vec<BorderEdge>> {
    let boundary = a.boundary.as_ref()?;
    let mut leaving = vec![NONE; a.vertices];
    for (corners, &f) in a.corners.iter().zip(&a.faces) {
        for k in 0..3 {
            if a.is_open(surface, 3 * f + k as u32) {
                leaving[corners[k] as usize] = 3 * f + k as u32;
            }
        }
    }
    let edge = |&v: &u32| {
        let half_edge = leaving[v as usize];
        let (face, other) = (half_edge as usize / 3, surface.opposite[half_edge as usize]);
        let shared = other != NONE && b.faces.binary_search(&(other / 3)).is_ok();
        let bend = if shared { 1.0 - surface.normal[face].dot(surface.normal[other as usize / 3]) } else { 0.0 };
        BorderEdge { half_edge, shared, length: surface.length[half_edge as usize], bend }
    };
    Some(boundary.iter().map(edge).collect())
}

/// The longest run of shared edges of a border that is not shared at `first`.
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

/// Of all runs of a quarter of a border, at least one edge, that along which the surface bends least.
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

    fn joined(surface: &Surface, a: Vec<u32>, b: Vec<u32>) -> Chart {
        let [a, b] = [a, b].map(|faces| Chart::new(surface, faces));
        let cuts = cuts(surface, &a, &b).expect("they touch");
        let mut faces = [a.faces, b.faces].concat();
        faces.sort_unstable();
        Chart::with_cuts(surface, faces, cuts)
    }

    #[test]
    fn two_halves_of_a_cube_open_on_a_hinge() {
        let surface = Surface::new(&cube(), None);
        let union = joined(&surface, (0..6).collect(), (6..12).collect());
        // Eight edges lie between the halves; a quarter of them is welded, and two triangles share each cut.
        assert_eq!((union.cuts.len(), union.boundary.map(|b| b.len())), (12, Some(12)));
    }

    #[test]
    fn two_halves_of_a_tube_are_joined_along_one_of_two_seams() {
        let surface = Surface::new(&cylinder(24), None);
        let union = joined(&surface, (0..24).collect(), (24..48).collect());
        assert!(union.boundary.is_some());
        // The other seam is one side of two triangles, cut from both.
        assert_eq!(union.cuts.len(), 2);
    }
}
