//! A sparse grid of distances and inside flags in bricks.

use glam::{IVec3, Vec3, Vec3A};

/// Samples along the side of a brick.
pub(super) const BRICK: usize = 8;
/// Samples of a brick.
pub(super) const BRICK_SAMPLES: usize = BRICK * BRICK * BRICK;
/// Index of a brick that holds no samples.
pub(super) const NO_BRICK: u32 = u32::MAX;

/// A cubic grid of samples that stores only the bricks near the surface.
pub(super) struct BrickGrid {
    /// Bricks along a side.
    pub(super) side: i32,
    /// Distance between samples in metres.
    pub(super) spacing: f32,
    /// Position of sample (0, 0, 0).
    pub(super) origin: Vec3A,
    /// Surface level in the distance field, in cells.
    pub(super) offset: f32,
    /// Index into `bricks` by brick coordinate, or [`NO_BRICK`].
    pub(super) table: Vec<u32>,
    pub(super) bricks: Vec<Brick>,
    /// True for a brick without samples that the flood has reached, by brick coordinate.
    pub(super) empty_outside: Vec<bool>,
}

/// 8 x 8 x 8 samples near the surface.
pub(super) struct Brick {
    /// Coordinate of the brick, in bricks.
    pub(super) coordinate: IVec3,
    /// Distance of each sample to the source in cells, x fastest; `f32::MAX` where it is too far from the surface level
    /// to matter.
    pub(super) distance: Box<[f32; BRICK_SAMPLES]>,
    /// Inside flags, one bit per sample.
    pub(super) inside: [u64; BRICK],
}

impl Brick {
    /// A brick far from the surface, entirely outside.
    pub(super) fn new(coordinate: IVec3) -> Self {
        Self { coordinate, distance: Box::new([f32::MAX; BRICK_SAMPLES]), inside: [0; BRICK] }
    }

    pub(super) fn is_inside(&self, sample: usize) -> bool {
        self.inside[sample >> 6] >> (sample & 63) & 1 == 1
    }

    pub(super) fn set_inside(&mut self, sample: usize, inside: bool) {
        let bit = 1 << (sample & 63);
        if inside { self.inside[sample >> 6] |= bit } else { self.inside[sample >> 6] &= !bit }
    }
}

impl BrickGrid {
    /// A grid of `side` cubed bricks that stores `bricks`; the flood has reached none.
    pub(super) fn new(side: i32, spacing: f32, origin: Vec3A, offset: f32, bricks: Vec<Brick>) -> Self {
        let slots = (side * side * side) as usize;
        let (table, empty_outside) = (vec![NO_BRICK; slots], vec![false; slots]);
        let mut grid = Self { side, spacing, origin, offset, table, bricks, empty_outside };
        for i in 0..grid.bricks.len() {
            if let Some(slot) = grid.slot(grid.bricks[i].coordinate) {
                grid.table[slot] = i as u32;
            }
        }
        grid
    }

    /// Index into `table` of a brick coordinate; `None` outside the grid.
    pub(super) fn slot(&self, brick: IVec3) -> Option<usize> {
        let within = brick.cmpge(IVec3::ZERO).all() && brick.cmplt(IVec3::splat(self.side)).all();
        within.then(|| (brick.x + self.side * (brick.y + self.side * brick.z)) as usize)
    }

    /// Index of the stored brick that holds a sample; `None` if there is none.
    pub(super) fn brick_of(&self, sample: IVec3) -> Option<usize> {
        let slot = self.slot(sample >> IVec3::splat(3))?;
        let index = self.table[slot];
        (index != NO_BRICK).then_some(index as usize)
    }

    fn is_inside(&self, sample: IVec3) -> bool {
        let Some(slot) = self.slot(sample >> IVec3::splat(3)) else { return false };
        match self.table[slot] {
            NO_BRICK => !self.empty_outside[slot],
            brick => self.bricks[brick as usize].is_inside(local_index(sample)),
        }
    }

    /// Signed distance to the extracted surface in cells, at most one. Its sign comes from the distance alone: negative
    /// within the offset.
    pub(super) fn level(&self, sample: IVec3) -> f32 {
        let brick = self.brick_of(sample);
        brick.map_or(1.0, |b| (self.bricks[b].distance[local_index(sample)] - self.offset).min(1.0))
    }

    /// The sample nearest to a position; it may lie outside the grid.
    pub(super) fn nearest_sample(&self, position: Vec3) -> IVec3 {
        ((Vec3A::from(position) - self.origin) / self.spacing).round().as_ivec3()
    }

    /// True if the sample nearest to a position is inside.
    pub(super) fn is_inside_at(&self, position: Vec3) -> bool {
        self.is_inside(self.nearest_sample(position))
    }

    /// Inside flags of a brick's samples and the first layer of the bricks after it: 9 x 9 x 9, x fastest.
    pub(super) fn inside_block(&self, brick: usize) -> [bool; 729] {
        let base = self.bricks[brick].coordinate * BRICK as i32;
        let mut block = [false; 729];
        for (i, flag) in block.iter_mut().enumerate() {
            let (x, y, z) = (i % 9, i / 9 % 9, i / 81);
            *flag = if x < BRICK && y < BRICK && z < BRICK {
                self.bricks[brick].is_inside(x + BRICK * (y + BRICK * z))
            } else {
                self.is_inside(base + IVec3::new(x as i32, y as i32, z as i32))
            };
        }
        block
    }
}

/// Index of a sample within its brick.
pub(super) fn local_index(sample: IVec3) -> usize {
    let l = sample & IVec3::splat(7);
    (l.x + 8 * l.y + 64 * l.z) as usize
}

/// Offset of corner `i` of a unit cube: (i & 1, i >> 1 & 1, i >> 2).
pub(super) fn corner_offset(i: i32) -> IVec3 {
    IVec3::new(i & 1, i >> 1 & 1, i >> 2)
}

/// Inside flags of the eight corners of a cell in the block of [`BrickGrid::inside_block`]; bit `i` belongs to the
/// corner at [`corner_offset`]`(i)`.
pub(super) fn cell_mask(block: &[bool; 729], x: usize, y: usize, z: usize) -> u8 {
    (0..8).fold(0, |mask, i| mask | u8::from(block[x + (i & 1) + 9 * (y + (i >> 1 & 1)) + 81 * (z + (i >> 2))]) << i)
}
