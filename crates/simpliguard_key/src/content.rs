//! Hashes of contents.

use blake3::hazmat::{self, ChainingValue, HasherExt, Mode};

/// Content of at least this many bytes is hashed on all threads.
const PARALLEL_FROM: usize = 1 << 20;
/// Bytes that one thread hashes at a time.
const PIECE: usize = 1 << 17;

/// Hashes any content with BLAKE3; a large one on the rayon pool of the caller.
///
/// `blake3` has a feature for this. It is not used, because the `blake3` of a game's Bevy would have that feature too.
pub fn content_hash(content: &[u8]) -> blake3::Hash {
    if content.len() < PARALLEL_FROM {
        return blake3::hash(content);
    }
    let [left, right] = subtrees(content, 0);
    hazmat::merge_subtrees_root(&left, &right, Mode::Hash)
}

/// Hashes the two subtrees of `content`, which begins at `offset` of the whole.
fn subtrees(content: &[u8], offset: u64) -> [ChainingValue; 2] {
    let length = hazmat::left_subtree_len(content.len() as u64);
    let (left, right) = content.split_at(length as usize);
    let (left, right) = rayon::join(|| subtree(left, offset), || subtree(right, offset + length));
    [left, right]
}

fn subtree(content: &[u8], offset: u64) -> ChainingValue {
    if content.len() <= PIECE {
        return blake3::Hasher::new().set_input_offset(offset).update(content).finalize_non_root();
    }
    let [left, right] = subtrees(content, offset);
    hazmat::merge_subtrees_non_root(&left, &right, Mode::Hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_threads_find_the_same_hash() {
        let content: Vec<u8> = (0..3 * PARALLEL_FROM).map(|i| (i / 3) as u8).collect();
        for length in [0, PARALLEL_FROM - 1, PARALLEL_FROM, PARALLEL_FROM + 7, 2 * PARALLEL_FROM + PIECE, content.len()]
        {
            assert_eq!(content_hash(&content[..length]), blake3::hash(&content[..length]), "{length} bytes");
        }
    }
}
