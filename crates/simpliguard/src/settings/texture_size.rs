//! The size of the levels' textures.

use ron::value::RawValue;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::value::{Limit, Value};

/// The side of the square textures of the levels, in texels.
///
/// In RON it is a number, a list of numbers, or `Auto`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TextureSize {
    /// One size for all levels, and half of it for levels of at most 1,000 faces.
    Texels(u32),
    /// The size of each level, the smallest level first. The last one is for all levels beyond.
    PerLevel(Vec<u32>),
    /// The size at which a level is seen where it comes into view, at most the built-in value of the quality.
    Auto,
}

/// The word in RON.
#[derive(Serialize, Deserialize)]
enum Word {
    Auto,
}

impl From<u32> for TextureSize {
    fn from(texels: u32) -> Self {
        Self::Texels(texels)
    }
}

impl Serialize for TextureSize {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Texels(texels) => texels.serialize(serializer),
            Self::PerLevel(all) => all.serialize(serializer),
            Self::Auto => Word::Auto.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for TextureSize {
    /// RON cannot tell a word from a number before it is read, so the text is read three times.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let raw = Box::<RawValue>::deserialize(deserializer)?;
        let text = raw.get_ron();
        let number = || ron::from_str(text).map(Self::Texels);
        let list = || ron::from_str(text).map(Self::PerLevel);
        let word = ron::from_str(text).map(|Word::Auto| Self::Auto);
        word.or_else(|_| number()).or_else(|_| list()).map_err(|_| D::Error::custom(format!("found {}", text.trim())))
    }
}

impl Value for TextureSize {
    fn accepts(limit: Limit) -> String {
        format!("{}, a list of 1 to 8 of them, or Auto", u32::accepts(limit))
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        match text.trim() {
            "auto" => Ok(Self::Auto),
            list if list.contains(',') => Vec::from_arg(list).map(Self::PerLevel),
            text => u32::from_arg(text).map(Self::Texels),
        }
        .map_err(|_| "a whole number, numbers with commas between, or auto".into())
    }

    fn ron(&self) -> String {
        match self {
            Self::Texels(texels) => texels.ron(),
            Self::PerLevel(all) => all.ron(),
            Self::Auto => "Auto".into(),
        }
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let is_allowed = match self {
            Self::Texels(texels) => texels.check(limit).is_ok(),
            Self::PerLevel(all) => all.check(limit).is_ok(),
            Self::Auto => true,
        };
        if is_allowed { Ok(()) } else { Err(Self::accepts(limit)) }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        match self {
            Self::Texels(texels) => texels.nearest(limit).map(Self::Texels),
            Self::PerLevel(all) => all.nearest(limit).map(Self::PerLevel),
            Self::Auto => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Limit = Limit::PowerOfTwo(64, 4096);

    #[test]
    fn numbers_lists_and_the_word_are_read_from_both_spellings() {
        for (size, arg, ron) in [
            (TextureSize::Texels(512), "512", "512"),
            (TextureSize::PerLevel(vec![512, 64]), "512, 64", "[512, 64]"),
            (TextureSize::Auto, "auto", "Auto"),
        ] {
            assert_eq!(TextureSize::from_arg(arg), Ok(size.clone()));
            assert_eq!(size.ron(), ron);
            assert_eq!(ron::from_str::<TextureSize>(&format!(" {ron} // why\n")).expect(ron), size);
            assert_eq!(ron::to_string(&size).expect("writes").replace(',', ", "), ron);
            assert_eq!(size.check(LIMIT), Ok(()));
        }
        for bad in ["Automatic", "-1", "(64)x", "\"64\"", "[64, a]"] {
            assert!(ron::from_str::<TextureSize>(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn every_number_is_checked() {
        let expected = "a power of two from 64 to 4096, a list of 1 to 8 of them, or Auto";
        for bad in [TextureSize::Texels(100), TextureSize::PerLevel(vec![64, 100]), TextureSize::PerLevel(Vec::new())] {
            assert_eq!(bad.check(LIMIT), Err(expected.to_owned()));
        }
        assert_eq!(TextureSize::PerLevel(vec![64, 100]).nearest(LIMIT), Some(TextureSize::PerLevel(vec![64, 128])));
    }
}
