//! Structure loss: Laplacian smoothing of the displacement (`L_laplacian`, paper 3.4, on how far a vertex has moved
//! rather than on where it is, so that corners of the start are kept).

use glam::Vec3;

/// Neighbours of each vertex over edges, flattened.
pub(super) struct Laplacian {
    first: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Laplacian {
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut pairs: Vec<(u32, u32)> =
            triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let first = (0..=vertices as u32).map(|v| pairs.partition_point(|p| p.0 < v) as u32).collect();
        Self { first, neighbours: pairs.into_iter().map(|p| p.1).collect() }
    }

    /// Adds the gradient of `weight / n sum |mean of neighbours - own|^2` over the field `d`; returns that loss.
    pub(super) fn add_gradient(&self, d: &[Vec3], weight: f32, gradient: &mut [Vec3]) -> f64 {
        let scale = weight / d.len().max(1) as f32;
        let mut loss = 0.0;
        for v in 0..d.len() {
            let neighbours = &self.neighbours[self.first[v] as usize..self.first[v + 1] as usize];
            if neighbours.is_empty() {
                continue;
            }
            let part = 1.0 / neighbours.len() as f32;
            let delta = neighbours.iter().map(|&n| d[n as usize]).sum::<Vec3>() * part - d[v];
            loss += f64::from(scale * delta.length_squared());
            let g = delta * (2.0 * scale);
            gradient[v] -= g;
            for &n in neighbours {
                gradient[n as usize] += g * part;
            }
        }
        loss
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_matches_central_differences() {
        let laplacian = Laplacian::new(4, &[[0, 2, 1], [0, 1, 3], [0, 3, 2]]);
        let mut d = vec![Vec3::new(0.1, 0.4, -0.3), Vec3::X, Vec3::new(0.0, -0.7, 0.2), Vec3::ZERO];
        let mut gradient = vec![Vec3::ZERO; 4];
        laplacian.add_gradient(&d, 0.7, &mut gradient);
        for v in 0..4 {
            for axis in 0..3 {
                let h = 1e-2;
                let mut at = |x: f32| {
                    d[v][axis] += x;
                    let loss = laplacian.add_gradient(&d, 0.7, &mut [Vec3::ZERO; 4]);
                    d[v][axis] -= x;
                    loss
                };
                let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
                assert!((difference - f64::from(gradient[v][axis])).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn a_shared_translation_is_free() {
        let laplacian = Laplacian::new(3, &[[0, 1, 2]]);
        let mut gradient = vec![Vec3::ZERO; 3];
        assert_eq!(laplacian.add_gradient(&[Vec3::ONE; 3], 1.0, &mut gradient), 0.0);
        assert_eq!(gradient, [Vec3::ZERO; 3]);
    }
}
