//! Targets of levels.

use serde::{Deserialize, Serialize};

use super::value::{Limit, MAX_LEVELS, Value, kebab};

/// The target that a level must meet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Target {
    /// At most this many triangles.
    Faces(u32),
    /// At most this fraction of the source's triangles.
    Ratio(f32),
    /// The fewest triangles that keep 95 % of both surfaces within this distance of each other, as a fraction of the
    /// diagonal of the source's bounding box.
    MaxDeviation(f32),
    /// The fewest triangles that keep 95 % of both surfaces within a pixel of each other if that diagonal is this many
    /// pixels long on the screen.
    ScreenSize(u32),
}

/// Name and range of each variant.
const KINDS: [(&str, Limit); 4] = [
    ("Faces", Limit::Between(4.0, 1e6)),
    ("Ratio", Limit::Between(0.0001, 0.99)),
    ("MaxDeviation", Limit::Between(0.0001, 0.1)),
    ("ScreenSize", Limit::Between(8.0, 4096.0)),
];

impl Target {
    /// Largest distance between 95 % of both surfaces, as a fraction of the bounding box's diagonal; `None` for a
    /// number of triangles.
    pub fn tolerance(self) -> Option<f32> {
        match self {
            Self::MaxDeviation(distance) => Some(distance),
            Self::ScreenSize(pixels) => Some(1.0 / pixels as f32),
            Self::Faces(_) | Self::Ratio(_) => None,
        }
    }

    fn in_range(self) -> bool {
        match self {
            Self::Faces(n) => n.check(KINDS[0].1),
            Self::Ratio(ratio) => ratio.check(KINDS[1].1),
            Self::MaxDeviation(distance) => distance.check(KINDS[2].1),
            Self::ScreenSize(pixels) => pixels.check(KINDS[3].1),
        }
        .is_ok()
    }

    /// Reads `screen-size:200`, as on the command line.
    fn parse(text: &str) -> Option<Self> {
        let (name, value) = text.trim().split_once(':')?;
        let kind = KINDS.iter().position(|(kind, _)| kebab(kind) == name)?;
        Some(match kind {
            0 => Self::Faces(value.parse().ok()?),
            1 => Self::Ratio(value.parse().ok()?),
            2 => Self::MaxDeviation(value.parse().ok()?),
            _ => Self::ScreenSize(value.parse().ok()?),
        })
    }
}

impl Value for Vec<Target> {
    fn accepts(_: Limit) -> String {
        let kinds = KINDS.map(|(name, limit)| format!("{name}(n), n{}", limit.words()));
        format!("at most {MAX_LEVELS} of: {}", kinds.join("; "))
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Ok(Self::new());
        }
        let parsed: Option<Self> = text.split(',').map(Target::parse).collect();
        parsed.ok_or_else(|| "targets with commas between, such as ratio:0.1,screen-size:200".into())
    }

    fn ron(&self) -> String {
        format!("{self:?}")
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let allowed = self.len() <= MAX_LEVELS && self.iter().all(|target| target.in_range());
        if allowed { Ok(()) } else { Err(Self::accepts(limit)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_read_from_both_spellings() {
        let expected =
            vec![Target::Faces(500), Target::Ratio(0.25), Target::MaxDeviation(0.01), Target::ScreenSize(200)];
        let arg = "faces:500, ratio:0.25,max-deviation:0.01,screen-size:200";
        assert_eq!(Vec::<Target>::from_arg(arg), Ok(expected.clone()));
        let ron = "[Faces(500), Ratio(0.25), MaxDeviation(0.01), ScreenSize(200)]";
        assert_eq!(expected.ron(), ron);
        assert_eq!(ron::from_str::<Vec<Target>>(ron).expect("valid"), expected);
        assert_eq!(Vec::<Target>::from_arg(""), Ok(Vec::new()));
        assert!(Vec::<Target>::from_arg("ratio=1").is_err() && Vec::<Target>::from_arg("depth:1").is_err());
    }

    #[test]
    fn each_kind_has_its_range() {
        for bad in [Target::Faces(3), Target::Ratio(1.0), Target::MaxDeviation(0.5), Target::ScreenSize(5000)] {
            assert!(vec![bad].check(Limit::None).is_err(), "{bad:?}");
        }
        assert!(vec![Target::Ratio(0.5); 9].check(Limit::None).is_err());
    }

    #[test]
    fn a_pixel_is_a_part_of_the_diagonal() {
        assert_eq!(Target::ScreenSize(200).tolerance(), Some(0.005));
        assert_eq!(Target::Ratio(0.5).tolerance(), None);
    }
}
