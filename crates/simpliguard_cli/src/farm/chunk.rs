//! Tasks: models put together so that each task takes about the same time.

use super::cost::Cost;

/// The models of one task.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chunk {
    /// Places in the list of models.
    pub(super) models: Vec<usize>,
    /// Estimated seconds.
    pub(super) seconds: f64,
}

/// Puts models together until they take `seconds`. The longest come first: a long task that begins last would keep the whole
/// job waiting.
pub(super) fn chunks(costs: &[(usize, Cost)], seconds: f64) -> Vec<Chunk> {
    let mut sorted = costs.to_vec();
    // Stable, so that equal costs keep the order of the paths.
    sorted.sort_by(|a, b| b.1.seconds.total_cmp(&a.1.seconds));
    let mut chunks: Vec<Chunk> = Vec::new();
    for (model, cost) in sorted {
        match chunks.last_mut() {
            Some(chunk) if chunk.seconds + cost.seconds <= seconds => {
                chunk.models.push(model);
                chunk.seconds += cost.seconds;
            }
            _ => chunks.push(Chunk { models: vec![model], seconds: cost.seconds }),
        }
    }
    chunks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn models(costs: &[f64], seconds: f64) -> Vec<Vec<usize>> {
        let costs: Vec<_> = costs.iter().map(|&seconds| Cost { seconds, memory: 0 }).enumerate().collect();
        chunks(&costs, seconds).into_iter().map(|chunk| chunk.models).collect()
    }

    #[test]
    fn tasks_are_full_and_the_longest_come_first() {
        assert_eq!(models(&[1.0, 9.0, 1.0, 3.0, 2.0], 5.0), [vec![1], vec![3, 4], vec![0, 2]]);
        assert_eq!(models(&[1.0, 1.0], 0.0), [[0], [1]]);
        assert!(models(&[], 5.0).is_empty());
    }

    #[test]
    fn every_model_is_in_one_task() {
        let costs: Vec<f64> = (0..100).map(|n| f64::from(n * 37 % 11)).collect();
        let mut all: Vec<usize> = models(&costs, 20.0).concat();
        all.sort_unstable();
        assert_eq!(all, (0..100).collect::<Vec<_>>());
    }
}
