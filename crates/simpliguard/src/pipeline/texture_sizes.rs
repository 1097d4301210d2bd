//! Sizes of the levels' textures.

use serde::Serialize;

use crate::settings::{BakeSettings, TextureSize};

/// Levels of at most so many faces are seen from afar: half the texture is enough.
const SMALL_TEXTURE_FACES: u32 = 1000;
/// Side of the smallest texture.
const SMALLEST: u32 = 64;
/// Fraction of an atlas that charts fill, typically.
const FILL: f32 = 0.6;

/// How the size of a level's textures follows from the level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum TextureSizes {
    /// Levels of few faces have half the largest size.
    Faces,
    /// The sizes of the levels, the smallest level first.
    List(Vec<u32>),
    /// As many texels as pixels, times a factor, where the level comes into view.
    View {
        /// Texels for each pixel along a side.
        oversampling: f32,
    },
}

/// A level as far as the size of its textures follows from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LevelView {
    /// Index of the level, the smallest first.
    pub(crate) index: usize,
    /// Its outline is in its texture.
    pub(crate) has_cards: bool,
    /// Side in pixels of a square with the area of the level's surface, where the level comes into view.
    pub(crate) side: f32,
}

impl Default for LevelView {
    fn default() -> Self {
        Self { index: 0, has_cards: false, side: f32::INFINITY }
    }
}

impl LevelView {
    /// A level with an area, in squared diagonals of the source's bounding box, and with a distance to the source in
    /// diagonals. It comes into view where this distance is one pixel long.
    pub(crate) fn new(index: usize, has_cards: bool, (area, deviation): (f32, f32)) -> Self {
        Self { index, has_cards, side: area.sqrt() / deviation }
    }
}

impl TextureSizes {
    pub(super) fn new(settings: &BakeSettings) -> Self {
        match &settings.texture_size {
            TextureSize::Texels(_) => Self::Faces,
            TextureSize::PerLevel(all) => Self::List(all.clone()),
            TextureSize::Auto => Self::View { oversampling: settings.texture_oversampling },
        }
    }

    /// Side of the largest texture.
    pub(super) fn largest(&self, settings: &BakeSettings) -> u32 {
        match &settings.texture_size {
            TextureSize::Texels(texels) => *texels,
            TextureSize::PerLevel(all) => all.iter().copied().max().unwrap_or(SMALLEST),
            TextureSize::Auto => match BakeSettings::preset(settings.quality).texture_size {
                TextureSize::Texels(texels) => texels,
                TextureSize::PerLevel(_) | TextureSize::Auto => SMALLEST,
            },
        }
    }

    pub(super) fn is_by_faces(&self) -> bool {
        *self == Self::Faces
    }

    /// Side of a level's textures. Cards have their outline in the texture: they get the largest one, unless a list says
    /// otherwise.
    pub(super) fn of_level(&self, largest: u32, budget: u32, view: LevelView) -> u32 {
        let by_faces = match budget <= SMALL_TEXTURE_FACES && !view.has_cards {
            true => (largest / 2).max(SMALLEST),
            false => largest,
        };
        match self {
            Self::List(all) => all.get(view.index).or(all.last()).copied().unwrap_or(largest),
            Self::View { oversampling } if !view.has_cards => {
                power_of_two(oversampling * view.side / FILL.sqrt(), by_faces)
            }
            Self::Faces | Self::View { .. } => by_faces,
        }
    }
}

/// The power of two that is nearest to a side in its logarithm, from the smallest to the largest side.
fn power_of_two(side: f32, largest: u32) -> u32 {
    let mut size = SMALLEST;
    while size < largest && side > size as f32 * std::f32::consts::SQRT_2 {
        size *= 2;
    }
    size
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(texture_size: TextureSize) -> impl Fn(u32, LevelView) -> u32 {
        let settings = BakeSettings { texture_size, ..BakeSettings::default() };
        let sizes = TextureSizes::new(&settings);
        let largest = sizes.largest(&settings);
        move |budget, view| sizes.of_level(largest, budget, view)
    }

    #[test]
    fn a_level_that_comes_into_view_far_away_has_small_textures() {
        let auto = sizes(TextureSize::Auto);
        let side = |budget, deviation| auto(budget, LevelView::new(0, false, (1.0, deviation)));
        // A hundred pixels where it is 1 % away from its source, over a little more than half an atlas.
        assert_eq!([0.001, 0.005, 0.01, 0.02, 0.5].map(|deviation| side(2000, deviation)), [1024, 256, 128, 64, 64]);
        // Never more than by default, not even where nothing can be told apart.
        assert_eq!([1000, 2000].map(|budget| side(budget, 0.0)), [512, 1024]);
        assert_eq!(auto(2000, LevelView::new(0, false, (f32::NAN, 0.0))), 64);
        assert_eq!(auto(1000, LevelView::new(0, true, (1.0, 0.5))), 1024);
    }

    #[test]
    fn oversampling_multiplies_the_side() {
        let by_view = |oversampling| TextureSizes::View { oversampling };
        let view = LevelView::new(0, false, (1.0, 0.01));
        assert_eq!([0.5, 1.0, 2.0].map(|factor| by_view(factor).of_level(1024, 2000, view)), [64, 128, 256]);
    }

    #[test]
    fn a_list_is_for_each_level_and_its_last_size_for_the_rest() {
        let list = sizes(TextureSize::PerLevel(vec![64, 512]));
        let level = |index| list(500, LevelView { index, has_cards: index == 1, ..LevelView::default() });
        assert_eq!([0, 1, 2].map(level), [64, 512, 512]);
    }
}
