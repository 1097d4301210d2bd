//! A priority queue that does not distinguish costs exactly.
//!
//! A binary heap of a million entries misses the cache at every level of every pop. Here entries lie in buckets by the
//! leading bits of their cost, and two levels of bits find the first bucket that holds an entry. Entries leave a bucket
//! in the reverse order of their arrival: the last one is still in the cache, and with wide buckets neighbours are
//! collapsed one after another.

/// Precision of the order, as the number of low bits of a cost that do not count.
#[derive(Clone, Copy)]
pub(super) enum Precision {
    /// Within half a percent.
    Fine = 15,
    /// Within an eighth.
    Coarse = 20,
}

/// Entries in the order of their costs.
#[derive(Clone)]
pub(super) struct Queue<T> {
    /// Bits of a cost that are dropped.
    dropped: u32,
    buckets: Vec<Vec<T>>,
    /// One bit for each bucket that holds an entry.
    filled: Vec<u64>,
    /// One bit for each word of `filled` that is not zero.
    filled_words: Vec<u64>,
}

impl<T> Queue<T> {
    pub(super) fn new(precision: Precision) -> Self {
        let dropped = precision as u32;
        // A cost has no sign.
        let buckets = 1usize << (31 - dropped);
        Self {
            dropped,
            buckets: (0..buckets).map(|_| Vec::new()).collect(),
            filled: vec![0; buckets.div_ceil(64)],
            filled_words: vec![0; buckets.div_ceil(4096)],
        }
    }

    /// Adds an entry; `cost` must not be negative.
    pub(super) fn push(&mut self, cost: f32, entry: T) {
        let bucket = (cost.abs().to_bits() >> self.dropped) as usize;
        self.buckets[bucket].push(entry);
        self.filled[bucket / 64] |= 1 << (bucket % 64);
        self.filled_words[bucket / 4096] |= 1 << (bucket / 64 % 64);
    }

    /// Takes an entry out of the lowest bucket.
    pub(super) fn pop(&mut self) -> Option<T> {
        let group = self.filled_words.iter().position(|&bits| bits != 0)?;
        let word = 64 * group + self.filled_words[group].trailing_zeros() as usize;
        let bucket = 64 * word + self.filled[word].trailing_zeros() as usize;
        let entry = self.buckets[bucket].pop();
        if self.buckets[bucket].is_empty() {
            self.buckets[bucket] = Vec::new();
            self.filled[word] &= !(1 << (bucket % 64));
            if self.filled[word] == 0 {
                self.filled_words[group] &= !(1 << (word % 64));
            }
        }
        entry
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(precision: Precision, costs: &[f32]) -> Vec<usize> {
        let mut queue = Queue::new(precision);
        for (i, cost) in costs.iter().enumerate() {
            queue.push(*cost, i);
        }
        std::iter::from_fn(|| queue.pop()).collect()
    }

    #[test]
    fn entries_leave_by_cost() {
        let costs = [3.0, 0.0, 1e-30, 7e9, -0.0, 1.5, 1e-3, f32::MAX, f32::INFINITY];
        for precision in [Precision::Fine, Precision::Coarse] {
            assert_eq!(order(precision, &costs), [4, 1, 2, 6, 5, 0, 3, 7, 8]);
        }
    }

    #[test]
    fn costs_are_told_apart_to_the_precision() {
        assert_eq!(order(Precision::Fine, &[1.005, 1.0, 1.0]), [2, 1, 0]);
        assert_eq!(order(Precision::Coarse, &[1.125, 1.0, 1.1]), [2, 1, 0]);
    }
}
