//! The places of tiles whose sides are powers of two.

use super::tile::LEAST_SIDE;

/// The place of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Column and row of its first texel.
    pub(super) corner: [u32; 2],
    /// Texels along a side.
    pub(super) side: u32,
}

/// The places of all tiles in a square.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Texels along a side of the square, a power of two.
    pub(super) side: u32,
    /// Number of times that tiles are halved.
    pub(super) halvings: u32,
    /// In the order of the tiles.
    pub(super) places: Vec<Place>,
}

impl Layout {
    /// Lays out tiles of these sides, powers of two, in the smallest square that holds them. If it would be larger than `most`,
    /// all tiles are halved, as long as they are larger than the least tile.
    pub(super) fn new(sides: &[u32], most: u32) -> Self {
        let area = |halvings: u32| sides.iter().map(|&side| u64::from(halved(side, halvings)).pow(2)).sum::<u64>();
        let fits = |halvings: &u32| area(*halvings) <= u64::from(most).pow(2);
        let halvings = (0..u32::BITS).find(fits).unwrap_or(u32::BITS - 1);
        let side = (0..u32::BITS).map(|bit| 1 << bit).find(|&side: &u32| area(halvings) <= u64::from(side).pow(2));
        let mut order: Vec<usize> = (0..sides.len()).collect();
        order.sort_by_key(|&tile| std::cmp::Reverse(sides[tile]));
        let mut places = vec![Place { corner: [0; 2], side: 0 }; sides.len()];
        // Squares of falling size fill a Z-order curve without gaps.
        let mut passed = 0_u64;
        for tile in order {
            let side = halved(sides[tile], halvings);
            places[tile] = Place { corner: [even_bits(passed), even_bits(passed >> 1)], side };
            passed += u64::from(side).pow(2);
        }
        Self { side: side.unwrap_or(most), halvings, places }
    }
}

/// The side of a tile after some halvings.
fn halved(side: u32, halvings: u32) -> u32 {
    side.checked_shr(halvings).unwrap_or(0).max(side.min(LEAST_SIDE))
}

/// The bits of even places, moved together.
fn even_bits(code: u64) -> u32 {
    (0..u32::BITS).map(|bit| ((code >> (2 * bit) & 1) as u32) << bit).sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn large_tiles_come_first_and_leave_no_gap() {
        let layout = Layout::new(&[8, 16, 8, 16], 64);
        let place = |x, y, side| Place { corner: [x, y], side };
        assert_eq!((layout.side, layout.halvings), (32, 0));
        assert_eq!(layout.places, [place(0, 16, 8), place(0, 0, 16), place(8, 16, 8), place(16, 0, 16)]);
    }

    #[test]
    fn tiles_are_halved_until_they_fit() {
        let layout = Layout::new(&[64; 16], 64);
        assert_eq!((layout.side, layout.halvings), (64, 2));
        assert_eq!(layout.places[15], Place { corner: [48, 48], side: 16 });
    }

    #[test]
    fn small_tiles_keep_their_least_size() {
        let layout = Layout::new(&[1024, 4], 256);
        assert_eq!(layout.halvings, 3, "a square of 256 would leave no room for the small one");
        assert_eq!(layout.places.iter().map(|place| place.side).collect::<Vec<_>>(), [128, 4]);
    }

    proptest! {
        #[test]
        fn tiles_lie_in_the_square_and_never_overlap(bits in proptest::collection::vec(2_u32..8, 1..40)) {
            let sides: Vec<u32> = bits.iter().map(|bit| 1 << bit).collect();
            let layout = Layout::new(&sides, 256);
            prop_assert!(layout.side <= 256);
            let mut taken = vec![false; 256 * 256];
            for place in &layout.places {
                for (x, y) in (0..place.side).flat_map(|x| (0..place.side).map(move |y| (x, y))) {
                    let [x, y] = [place.corner[0] + x, place.corner[1] + y];
                    prop_assert!(x < layout.side && y < layout.side);
                    prop_assert!(!std::mem::replace(&mut taken[(y * 256 + x) as usize], true));
                }
            }
        }
    }
}
