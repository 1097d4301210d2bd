//! Makes the set of inside samples well-composed (Latecki 1997): in no cell are inside or outside samples connected
//! across a diagonal only. Samples are only added to the inside, so the loop ends.

use std::collections::BTreeSet;

use glam::IVec3;
use rayon::prelude::*;

use super::grid::{BRICK, BRICK_SAMPLES, BrickGrid, NO_BRICK, cell_mask, corner_offset, local_index};

/// Adds samples to the inside until every cell is well-composed.
pub(super) fn make_well_composed(grid: &mut BrickGrid) {
    let mut work: Vec<u32> = (0..grid.bricks.len() as u32).collect();
    while !work.is_empty() {
        let flips: Vec<IVec3> = work.par_iter().flat_map_iter(|&brick| flips_of(grid, brick as usize)).collect();
        let mut next = BTreeSet::new();
        for sample in flips {
            let Some(brick) = grid.brick_of(sample) else { continue };
            grid.bricks[brick].set_inside(local_index(sample), true);
            // Cells that contain the sample start in this brick or in one before it.
            for offset in 0..8 {
                if let Some(slot) = grid.slot((sample >> IVec3::splat(3)) - corner_offset(offset))
                    && grid.table[slot] != NO_BRICK
                {
                    next.insert(grid.table[slot]);
                }
            }
        }
        work = next.into_iter().collect();
    }
}

/// Samples to add to the inside in the cells that start in a brick.
fn flips_of(grid: &BrickGrid, brick: usize) -> Vec<IVec3> {
    let base = grid.bricks[brick].coordinate * BRICK as i32;
    let block = grid.inside_block(brick);
    let mut flips = Vec::new();
    for i in 0..BRICK_SAMPLES {
        let (x, y, z) = (i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK));
        let mask = cell_mask(&block, x, y, z);
        if mask != 0
            && mask != 255
            && let Some(corner) = corner_to_flip(mask)
        {
            let cell = IVec3::new(x as i32, y as i32, z as i32);
            flips.push(base + cell + corner_offset(corner));
        }
    }
    flips
}

/// An outside corner of a cell that removes a diagonal connection once it is inside; `None` if the cell has no such
/// connection.
fn corner_to_flip(mask: u8) -> Option<i32> {
    const FACES: [[u8; 4]; 6] = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let inside = |corner: u8| mask >> corner & 1 == 1;
    for [a, b, c, d] in FACES {
        if inside(a) == inside(c) && inside(b) == inside(d) && inside(a) != inside(b) {
            return Some(i32::from(if inside(a) { b } else { a }));
        }
    }
    for corner in 0..4u8 {
        let diagonal = 1u8 << corner | 1 << (7 - corner);
        if mask == diagonal {
            return Some(i32::from(corner ^ 1));
        }
        if mask == !diagonal {
            return Some(i32::from(corner));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::corner_to_flip;

    #[test]
    fn flipping_ends_in_a_well_composed_cell_for_every_mask() {
        for start in 0..=255u8 {
            let mut mask = start;
            while let Some(corner) = corner_to_flip(mask) {
                assert_eq!(mask >> corner & 1, 0, "flips go to the inside");
                mask |= 1 << corner;
            }
            assert_eq!(mask & start, start);
        }
    }

    #[test]
    fn faces_and_corners_need_no_flip() {
        for mask in [0b0000_1111, 0b0000_0001, 0b1111_1110, 0b0101_0101] {
            assert_eq!(corner_to_flip(mask), None);
        }
        assert!(corner_to_flip(0b0000_1001).is_some() && corner_to_flip(0b1000_0001).is_some());
    }
}
