//! Inside and outside, by a flood from a corner of the grid and from points that are known to be free.

use glam::{IVec3, Vec3};

use super::grid::{BRICK, BrickGrid, NO_BRICK, local_index};

/// A front element of the flood: one sample of a brick, or a whole brick without samples.
enum Reached {
    Sample { brick: u32, sample: u16 },
    Empty { slot: u32 },
}

const NEIGHBOURS: [IVec3; 6] = [IVec3::X, IVec3::NEG_X, IVec3::Y, IVec3::NEG_Y, IVec3::Z, IVec3::NEG_Z];

/// Marks as inside every sample that the flood does not reach from a corner of the grid and from the samples nearest to the
/// `free` points.
pub(super) fn mark_inside(grid: &mut BrickGrid, free: &[Vec3]) {
    for brick in &mut grid.bricks {
        brick.inside = [u64::MAX; BRICK];
    }
    let mut queue = Vec::new();
    enter(grid, IVec3::ZERO, &mut queue);
    for &point in free {
        enter(grid, grid.nearest_sample(point), &mut queue);
    }
    while let Some(reached) = queue.pop() {
        match reached {
            Reached::Sample { brick, sample } => {
                let sample = i32::from(sample);
                let at = grid.bricks[brick as usize].coordinate * BRICK as i32
                    + IVec3::new(sample & 7, sample >> 3 & 7, sample >> 6);
                for step in NEIGHBOURS {
                    enter(grid, at + step, &mut queue);
                }
            }
            Reached::Empty { slot } => {
                let (slot, side) = (slot as i32, grid.side);
                let brick = IVec3::new(slot % side, slot / side % side, slot / side / side);
                for step in NEIGHBOURS {
                    enter_brick(grid, brick, step, &mut queue);
                }
            }
        }
    }
}

/// Floods one sample, or the whole brick around it if the grid does not store that brick.
fn enter(grid: &mut BrickGrid, sample: IVec3, queue: &mut Vec<Reached>) {
    let Some(slot) = grid.slot(sample >> IVec3::splat(3)) else { return };
    let index = grid.table[slot];
    if index == NO_BRICK {
        if !grid.empty_outside[slot] {
            grid.empty_outside[slot] = true;
            queue.push(Reached::Empty { slot: slot as u32 });
        }
        return;
    }
    let (brick, local) = (&mut grid.bricks[index as usize], local_index(sample));
    if brick.is_inside(local) && brick.distance[local] > grid.offset {
        brick.set_inside(local, false);
        queue.push(Reached::Sample { brick: index, sample: local as u16 });
    }
}

/// Floods the neighbour of a brick without samples: all samples on their common side.
fn enter_brick(grid: &mut BrickGrid, brick: IVec3, step: IVec3, queue: &mut Vec<Reached>) {
    let Some(slot) = grid.slot(brick + step) else { return };
    let base = (brick + step) * BRICK as i32;
    if grid.table[slot] == NO_BRICK {
        enter(grid, base, queue);
        return;
    }
    let axis = (0..3).find(|&a| step[a] != 0).unwrap_or(0);
    let layer = if step[axis] > 0 { 0 } else { BRICK as i32 - 1 };
    for u in 0..BRICK as i32 {
        for v in 0..BRICK as i32 {
            let mut local = IVec3::ZERO;
            local[axis] = layer;
            local[(axis + 1) % 3] = u;
            local[(axis + 2) % 3] = v;
            enter(grid, base + local, queue);
        }
    }
}
