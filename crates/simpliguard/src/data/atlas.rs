//! The texture atlas of a level.

use glam::Vec2;

/// Texture coordinates of every face of a mesh.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Atlas {
    /// Coordinates of the three corners of each face, in `[0, 1]`, origin at the top left. The centre of texel `x` lies
    /// at `(x + 0.5) / size`. Every face has a positive signed area as `(u, v)` numbers.
    pub uvs: Vec<[Vec2; 3]>,
    /// Chart of each face, counted from 0. Within a chart, all corners at one vertex have equal coordinates.
    pub chart: Vec<u32>,
    /// Number of charts.
    pub charts: usize,
    /// Fraction of all texels whose centre a face covers.
    pub fill: f32,
    /// Area-weighted L2 stretch (Sander et al. 2001) relative to each chart's mean density; 1 = isometric.
    pub stretch: f32,
    /// Stretch in the L-infinity norm: the largest of any face.
    pub worst_stretch: f32,
    /// Texels per unit of length where the importance is 1.
    pub texels_per_unit: f32,
}

impl Atlas {
    /// The atlas of some of the faces. The figures are those of the whole.
    pub fn part(&self, faces: std::ops::Range<usize>) -> Self {
        Self { uvs: self.uvs[faces.clone()].to_vec(), chart: self.chart[faces].to_vec(), ..*self }
    }

    /// Checks the atlas of a mesh of `faces` faces: array lengths, coordinates in `[0, 1]`, positive signed areas, and
    /// charts below the number of charts.
    ///
    /// # Errors
    /// The first broken rule, with the face and the values found.
    pub fn validate(&self, faces: usize) -> Result<(), String> {
        if self.uvs.len() != faces || self.chart.len() != faces {
            let (uvs, charts) = (self.uvs.len(), self.chart.len());
            return Err(format!("the atlas has {uvs} coordinates and {charts} chart numbers for {faces} faces"));
        }
        for (face, (&[a, b, c], &chart)) in self.uvs.iter().zip(&self.chart).enumerate() {
            if let Some(uv) = [a, b, c].into_iter().find(|uv| !in_unit_square(*uv)) {
                return Err(format!("face {face} has the texture coordinate {uv} outside of [0, 1]"));
            }
            let area = (b - a).perp_dot(c - a);
            if area <= 0.0 {
                return Err(format!("face {face} has twice the signed area {area:e} in the atlas: {a} {b} {c}"));
            }
            if chart as usize >= self.charts {
                return Err(format!("face {face} lies in chart {chart} of {}", self.charts));
            }
        }
        Ok(())
    }
}

/// True if both coordinates are in `[0, 1]`; false for NaN.
pub(super) fn in_unit_square(uv: Vec2) -> bool {
    uv.to_array().iter().all(|c| (0.0..=1.0).contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_face() -> Atlas {
        Atlas { uvs: vec![[Vec2::ZERO, Vec2::X, Vec2::Y]], chart: vec![0], charts: 1, ..Atlas::default() }
    }

    #[test]
    fn a_sound_atlas_passes() {
        assert_eq!(one_face().validate(1), Ok(()));
        assert_eq!(Atlas::default().validate(0), Ok(()));
    }

    #[test]
    fn each_broken_rule_is_named() {
        let message = |edit: &dyn Fn(&mut Atlas)| {
            let mut atlas = one_face();
            edit(&mut atlas);
            atlas.validate(1).expect_err("broken")
        };
        assert!(message(&|atlas| atlas.uvs.clear()).contains("0 coordinates"));
        assert!(message(&|atlas| atlas.chart.push(0)).contains("2 chart numbers"));
        assert!(message(&|atlas| atlas.uvs[0][1].x = 1.001).contains("outside of [0, 1]"));
        assert!(message(&|atlas| atlas.uvs[0][2].y = f32::NAN).contains("outside of [0, 1]"));
        assert!(message(&|atlas| atlas.uvs[0].swap(1, 2)).contains("signed area -1"));
        assert!(message(&|atlas| atlas.uvs[0][2] = Vec2::ZERO).contains("signed area 0"));
        assert!(message(&|atlas| atlas.chart[0] = 1).contains("chart 1 of 1"));
    }
}
