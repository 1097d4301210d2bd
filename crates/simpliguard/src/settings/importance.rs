//! Which parts of a model matter more than others.

use globset::{GlobBuilder, GlobMatcher};
use serde::{Deserialize, Serialize};

use super::value::{Limit, Value};

/// The longest list.
const MOST: usize = 64;
/// Least and largest weight.
const RANGE: Limit = Limit::Between(0.01, 100.0);

/// How much more than others the faces of some materials count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Importance {
    /// Glob over the names of materials, `*Face*`; upper and lower case differ.
    pub material: String,
    /// Factor on the weight of the faces, both in the collapse and in the choice between candidates.
    pub weight: f32,
}

impl Importance {
    /// Tells names of materials apart; `None` if the glob is malformed.
    pub fn matcher(&self) -> Option<GlobMatcher> {
        GlobBuilder::new(&self.material).build().ok().map(|glob| glob.compile_matcher())
    }

    /// `*Face*:4`, as on the command line.
    fn parse(text: &str) -> Option<Self> {
        let (material, weight) = text.trim().rsplit_once(':')?;
        Some(Self { material: material.to_owned(), weight: weight.parse().ok()? })
    }
}

impl Value for Vec<Importance> {
    fn accepts(_: Limit) -> String {
        format!("at most {MOST} of (material: \"glob\", weight: w), w{}", RANGE.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Ok(Self::new());
        }
        let parsed: Option<Self> = text.split(',').map(Importance::parse).collect();
        parsed.ok_or_else(|| "globs and weights with commas between, such as *Face*:4,Hair:0.5".into())
    }

    fn ron(&self) -> String {
        let item = |i: &Importance| format!("(material: {:?}, weight: {:?})", i.material, i.weight);
        format!("[{}]", self.iter().map(item).collect::<Vec<_>>().join(", "))
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let sound = |i: &Importance| i.weight.check(RANGE).is_ok() && i.matcher().is_some();
        if self.len() <= MOST && self.iter().all(sound) { Ok(()) } else { Err(Self::accepts(limit)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face() -> Importance {
        Importance { material: "*Face*".into(), weight: 4.0 }
    }

    #[test]
    fn importances_are_read_from_both_spellings() {
        let expected = vec![face(), Importance { material: "a:b".into(), weight: 0.5 }];
        assert_eq!(Vec::<Importance>::from_arg("*Face*:4, a:b:0.5"), Ok(expected.clone()));
        let ron = r#"[(material: "*Face*", weight: 4.0), (material: "a:b", weight: 0.5)]"#;
        assert_eq!(expected.ron(), ron);
        assert_eq!(ron::from_str::<Vec<Importance>>(ron).expect("valid"), expected);
        assert_eq!(Vec::<Importance>::from_arg(" "), Ok(Vec::new()));
        assert!(Vec::<Importance>::from_arg("*Face*").is_err());
    }

    #[test]
    fn weights_have_a_range_and_globs_a_grammar() {
        assert!(vec![face()].check(Limit::None).is_ok());
        for bad in [Importance { weight: 0.0, ..face() }, Importance { weight: f32::NAN, ..face() }] {
            assert!(vec![bad].check(Limit::None).is_err());
        }
        assert!(vec![Importance { material: "[".into(), ..face() }].check(Limit::None).is_err());
    }

    #[test]
    fn a_glob_finds_names() {
        let matcher = face().matcher().expect("sound");
        assert!(matcher.is_match("Head/FaceSkin") && !matcher.is_match("surface"));
    }
}
