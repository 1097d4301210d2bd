//! Values of the field `shared_atlas`.

use ron::value::RawValue;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::value::{Limit, Value};

/// The side of textures that levels share, in texels.
///
/// In RON it is a number, or `Off`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AtlasSize {
    /// Each level has textures of its own.
    #[default]
    Off,
    /// At most so many texels along a side.
    Texels(u32),
}

/// The word in RON.
#[derive(Serialize, Deserialize)]
enum Word {
    Off,
}

impl Serialize for AtlasSize {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Off => Word::Off.serialize(serializer),
            Self::Texels(texels) => texels.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for AtlasSize {
    /// RON cannot tell a word from a number before it is read, so the text is read twice.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let raw = Box::<RawValue>::deserialize(deserializer)?;
        let text = raw.get_ron();
        let word = ron::from_str(text).map(|Word::Off| Self::Off);
        let number = || ron::from_str(text).map(Self::Texels);
        word.or_else(|_| number()).map_err(|_| D::Error::custom(format!("found {}", text.trim())))
    }
}

impl Value for AtlasSize {
    fn accepts(limit: Limit) -> String {
        format!("{}, or Off", u32::accepts(limit))
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        match text.trim() {
            "off" => Ok(Self::Off),
            text => u32::from_arg(text).map(Self::Texels).map_err(|_| "a whole number, or off".into()),
        }
    }

    fn ron(&self) -> String {
        match self {
            Self::Off => "Off".into(),
            Self::Texels(texels) => texels.ron(),
        }
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        match self {
            Self::Texels(texels) if !limit.allows_whole(*texels) => Err(Self::accepts(limit)),
            _ => Ok(()),
        }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        match self {
            Self::Off => None,
            Self::Texels(texels) => texels.nearest(limit).map(Self::Texels),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Limit = Limit::PowerOfTwo(64, 8192);

    #[test]
    fn numbers_and_the_word_are_read_from_both_spellings() {
        for (size, arg, ron) in [(AtlasSize::Texels(512), "512", "512"), (AtlasSize::Off, "off", "Off")] {
            assert_eq!(AtlasSize::from_arg(arg), Ok(size));
            assert_eq!(size.ron(), ron);
            assert_eq!(ron::from_str::<AtlasSize>(&format!(" {ron} // why\n")).expect(ron), size);
            assert_eq!(ron::to_string(&size).expect("writes"), ron);
            assert_eq!(size.check(LIMIT), Ok(()));
        }
        for bad in ["Of", "-1", "true", "[64]"] {
            assert!(ron::from_str::<AtlasSize>(bad).is_err(), "{bad}");
        }
        let bad = AtlasSize::Texels(100);
        assert_eq!(bad.check(LIMIT), Err("a power of two from 64 to 8192, or Off".into()));
        assert_eq!(bad.nearest(LIMIT), Some(AtlasSize::Texels(128)));
    }
}
