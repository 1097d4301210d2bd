//! Lattices: flat things of many bars, such as window bars, railings, nets, trusses and spokes.
//!
//! Edge collapse needs a few faces for each bar, and turns a net into a sheet when it runs out of them. A card needs two
//! faces for all bars: a rectangle, cut out by alpha, as in billboard clouds (Décoret et al. 2003). Unlike foliage, a
//! lattice is seen to be flat, so the rectangle has its true outline from everywhere.

mod bars;
mod lattice;
mod part;
mod segment;
mod wires;

use std::cmp::Reverse;

use crate::data::{Cards, Model, NO_CARD, Surface, TriMesh};
use crate::geometry::{BoundingSphere, face_components, group_by_component};

use super::layer_shape::LayerShape;
use super::oriented_box::OrientedBox;
use super::weld;
use bars::planes_of_bars;
use part::{Part, THICKNESS};
use wires::straight_pieces;

pub use lattice::Lattice;

/// Fewest triangles of a lattice: what has fewer is cheap as it is.
const FEWEST_TRIANGLES: usize = 100;

/// Finds the lattices of a surface. At most `most`, those of the most triangles first.
///
/// A lattice is one flat component with many holes, or many thin bars in one plane; a wire that bends is several bars. It
/// is rigid and does not change its shape. `is_eligible` tells what may belong to one.
pub fn find_lattices(surface: &Surface, is_eligible: &dyn Fn(u32) -> bool, most: usize) -> Vec<Lattice> {
    if surface.morphs.is_some() || most == 0 {
        return Vec::new();
    }
    let eligible: Vec<u32> = (0..surface.triangles.len() as u32).filter(|&t| is_eligible(t)).collect();
    let triangles: Vec<[u32; 3]> = eligible.iter().map(|&t| surface.triangles[t as usize]).collect();
    let (mesh, welded_from) = weld::weld(&surface.positions, &triangles);
    let radius = BoundingSphere::around(&surface.positions).radius;
    let source = |triangles: &[u32]| -> Vec<u32> {
        triangles.iter().map(|&t| eligible[welded_from[t as usize] as usize]).collect()
    };
    let components = group_by_component(&face_components(mesh.positions.len(), &mesh.triangles));
    let (mut lattices, mut bars) = (Vec::new(), Vec::new());
    for triangles in components {
        let of_component = source(&triangles);
        let Some(bone) = bone(surface, &of_component) else { continue };
        let part = Part::new(&mesh, &triangles, of_component, bone);
        let holes = (triangles.len() >= FEWEST_TRIANGLES).then(|| part.holes(&mesh, &triangles, radius)).flatten();
        if let Some(holes) = holes {
            lattices.push(Lattice { triangles: part.triangles, bars: holes });
        } else if part.is_bar(radius) {
            bars.push(part);
        } else {
            let pieces = straight_pieces(&mesh, &triangles, THICKNESS * radius);
            let pieces = pieces.iter().map(|piece| Part::new(&mesh, piece, source(piece), bone));
            bars.extend(pieces.filter(|piece| piece.is_bar(radius)));
        }
    }
    lattices.extend(planes_of_bars(&bars, radius, most));
    lattices.retain(|lattice| lattice.triangles.len() >= FEWEST_TRIANGLES);
    lattices.sort_by_key(|lattice| (Reverse(lattice.triangles.len()), lattice.triangles[0]));
    lattices.truncate(most);
    lattices
}

/// The bone that holds all of the triangles; `u16::MAX` in a static model, `None` if several do.
fn bone(surface: &Surface, triangles: &[u32]) -> Option<u16> {
    let rigid = |v: u32| surface.influences.get(v as usize).map_or(Some(u16::MAX), |i| i.rigid_joint());
    let mut bones = triangles.iter().flat_map(|&t| surface.triangles[t as usize]).map(rigid);
    let first = bones.next()??;
    bones.all(|bone| bone == Some(first)).then_some(first)
}

/// One card for each lattice of a model of lattices. `lattice` has the lattice of each triangle.
pub fn lattice_cards(model: &Model, lattice: &[u32]) -> LayerShape {
    let mut mesh = TriMesh::default();
    let mut cards = Cards { group: Vec::new(), source_group: vec![NO_CARD; lattice.len()], reach: Vec::new() };
    let surface = &model.surface;
    for (group, triangles) in group_by_component(lattice).into_iter().enumerate() {
        let corners = |&t: &u32| surface.triangles[t as usize].map(|v| surface.positions[v as usize]);
        let points: Vec<_> = triangles.iter().flat_map(corners).collect();
        triangles.iter().for_each(|&t| cards.source_group[t as usize] = group as u32);
        cards.reach.push(OrientedBox::around(&points).turned(&points).add_rectangle(&mut mesh));
        cards.group.extend([group as u32; 2]);
    }
    LayerShape { mesh, double_sided: true, cards: Some(cards), parts: None }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::wires::tests::tube;
    use super::*;
    use crate::data::Influences;

    /// Adds a box from `low` to `high`.
    fn add_box(surface: &mut Surface, low: Vec3, high: Vec3) {
        let first = surface.positions.len() as u32;
        let corner = |i: u32| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
        surface.positions.extend((0..8).map(corner));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in quads.map(|quad: [u32; 4]| quad.map(|v| first + v)) {
            surface.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }

    /// A cube of 2 m, and beside it `n` bars of 1 m in one plane.
    fn cube_and_bars(n: usize) -> Surface {
        let mut surface = Surface::default();
        add_box(&mut surface, Vec3::splat(-1.0), Vec3::ONE);
        for i in 0..n {
            let x = 1.5 + i as f32 * 0.05;
            add_box(&mut surface, Vec3::new(x, -0.5, 0.0), Vec3::new(x + 0.01, 0.5, 0.01));
        }
        surface
    }

    /// A frame with `n` x `n` holes, one component: the walls of a grid, 1 cm thick.
    fn grid(n: usize) -> Surface {
        let mut surface = Surface::default();
        let side = 2 * n + 1;
        // Cells of the plane that are filled: all but those with two odd indices.
        let filled = |x: i32, y: i32| {
            (0..side as i32).contains(&x) && (0..side as i32).contains(&y) && (x % 2 == 0 || y % 2 == 0)
        };
        let mut ids = std::collections::HashMap::new();
        let mut vertex = |x: i32, y: i32, z: i32, positions: &mut Vec<Vec3>| {
            *ids.entry((x, y, z)).or_insert_with(|| {
                positions.push(Vec3::new(x as f32 * 0.1, y as f32 * 0.1, z as f32 * 0.01));
                positions.len() as u32 - 1
            })
        };
        for (x, y) in (0..side as i32).flat_map(|x| (0..side as i32).map(move |y| (x, y))).filter(|c| filled(c.0, c.1))
        {
            let mut quad = |corners: [[i32; 3]; 4]| {
                let [a, b, c, d] = corners.map(|[x, y, z]| vertex(x, y, z, &mut surface.positions));
                surface.triangles.extend([[a, b, c], [a, c, d]]);
            };
            quad([[x, y, 1], [x + 1, y, 1], [x + 1, y + 1, 1], [x, y + 1, 1]]);
            quad([[x, y, 0], [x, y + 1, 0], [x + 1, y + 1, 0], [x + 1, y, 0]]);
            let walls = [
                ([-1, 0], [[x, y + 1], [x, y]]),
                ([1, 0], [[x + 1, y], [x + 1, y + 1]]),
                ([0, -1], [[x, y], [x + 1, y]]),
                ([0, 1], [[x + 1, y + 1], [x, y + 1]]),
            ];
            for ([dx, dy], [[ax, ay], [bx, by]]) in walls {
                if !filled(x + dx, y + dy) {
                    quad([[ax, ay, 0], [bx, by, 0], [bx, by, 1], [ax, ay, 1]]);
                }
            }
        }
        surface
    }

    fn find(surface: &Surface) -> Vec<usize> {
        find_lattices(surface, &|_| true, 10).iter().map(|lattice| lattice.triangles.len()).collect()
    }

    #[test]
    fn many_bars_in_a_plane_are_a_lattice_and_the_cube_beside_them_is_none() {
        let surface = cube_and_bars(16);
        let lattices = find_lattices(&surface, &|_| true, 10);
        assert_eq!(lattices.len(), 1);
        let Lattice { triangles, bars } = &lattices[0];
        assert_eq!((triangles.len(), triangles[0], *bars), (16 * 12, 12, 16));
        assert!(find(&cube_and_bars(8)).is_empty());
    }

    #[test]
    fn bars_that_stand_about_are_no_lattice() {
        let mut surface = cube_and_bars(0);
        for i in 0..16 {
            // A crooked row.
            let (x, z) = (1.5 + i as f32 * 0.05, [0.0, 0.4, -0.3, 0.7][i % 4] + i as f32 * 0.02);
            add_box(&mut surface, Vec3::new(x, -0.5, z), Vec3::new(x + 0.01, 0.5, z + 0.01));
        }
        assert!(find(&surface).is_empty());
    }

    #[test]
    fn layers_of_bars_are_a_lattice_each() {
        let mut surface = cube_and_bars(16);
        for i in 0..16 {
            let x = 1.5 + i as f32 * 0.05;
            add_box(&mut surface, Vec3::new(x, -0.5, 0.06), Vec3::new(x + 0.01, 0.5, 0.07));
        }
        assert_eq!(find(&surface), [16 * 12; 2]);
    }

    #[test]
    fn spokes_that_bend_at_the_rim_are_a_lattice_on_each_side_of_the_wheel() {
        let mut surface = Surface::default();
        for i in 0..24 {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / 24.0).sin_cos();
            let at = |radius: f32, z: f32| Vec3::new(cos * radius, sin * radius, z);
            let points = [at(0.05, 0.06), at(0.5, 0.03), at(1.0, 0.0), at(0.5, -0.03), at(0.05, -0.06)];
            // Along the rim for a little, so that the ring there does not fold.
            let rim = Vec3::new(-sin, cos, 0.0) * 0.003;
            let wire = tube(&[points[0], points[1], points[2] - rim, points[2] + rim, points[3], points[4]], 0.002);
            let first = surface.positions.len() as u32;
            surface.triangles.extend(wire.triangles.iter().map(|t| t.map(|v| v + first)));
            surface.positions.extend(wire.positions);
        }
        let lattices = find_lattices(&surface, &|_| true, 10);
        assert_eq!(lattices.iter().map(|lattice| lattice.bars).collect::<Vec<_>>(), [24, 24]);
        let z = |&t: &u32| surface.triangles[t as usize].map(|v| surface.positions[v as usize].z).iter().sum::<f32>();
        let [one, other] = [0, 1].map(|i| lattices[i].triangles.iter().map(z).sum::<f32>());
        assert!(one * other < 0.0 && (one + other).abs() < 0.1 * one.abs(), "{one} {other}");
    }

    #[test]
    fn a_flat_component_with_many_holes_is_a_lattice_and_a_frame_is_none() {
        assert_eq!(find_lattices(&grid(4), &|_| true, 10).iter().map(|l| l.bars).collect::<Vec<_>>(), [16]);
        assert!(find(&grid(1)).is_empty());
    }

    #[test]
    fn bars_of_several_bones_are_no_lattice() {
        let mut surface = cube_and_bars(16);
        let joint = |v: usize| Influences::rigid(u16::from((v / 8).is_multiple_of(2)));
        surface.influences = (0..surface.positions.len()).map(joint).collect();
        assert!(find(&surface).is_empty());
        surface.influences.fill(Influences::rigid(0));
        assert_eq!(find(&surface), [16 * 12]);
    }

    #[test]
    fn a_lattice_becomes_one_rectangle_of_its_size() {
        let mut surface = cube_and_bars(16);
        surface.material = vec![0; surface.triangles.len()];
        let lattice = find_lattices(&surface, &|_| true, 10).remove(0).triangles;
        let model = Model { surface: surface.subset(&lattice), ..Model::empty("bars") };
        let LayerShape { mesh, cards, .. } = lattice_cards(&model, &vec![0; lattice.len()]);
        let cards = cards.expect("a card");
        assert_eq!((mesh.triangles.len(), cards.group, cards.source_group.len()), (2, vec![0, 0], 16 * 12));
        assert!((mesh.area() - 0.76).abs() < 0.01, "{}", mesh.area());
    }
}
