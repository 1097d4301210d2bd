//! Blocks of 2 x 2 pixels, for images at half the resolution.

/// Indices of the four pixels of an image `size` pixels wide that pixel `i` of the half-resolution image covers.
#[inline]
pub(crate) fn two_by_two(i: usize, size: usize) -> [usize; 4] {
    let half = size / 2;
    let k = 2 * (i / half * size + i % half);
    [k, k + 1, k + size, k + size + 1]
}
