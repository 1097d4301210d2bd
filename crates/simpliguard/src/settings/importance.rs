//! Values of the field `importance`.

use super::value::{Limit, Value};
use crate::data::MaterialWeight;

/// Most entries of the list.
const MOST: usize = 64;
/// Least and largest weight.
const RANGE: Limit = Limit::Between(0.01, 100.0);

/// Reads `*Face*:4`, as on the command line.
fn parse(text: &str) -> Option<MaterialWeight> {
    let (material, weight) = text.trim().rsplit_once(':')?;
    Some(MaterialWeight { material: material.to_owned(), weight: weight.parse().ok()? })
}

impl Value for Vec<MaterialWeight> {
    fn accepts(_: Limit) -> String {
        format!("at most {MOST} of (material: \"glob\", weight: w), w{}", RANGE.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Ok(Self::new());
        }
        let parsed: Option<Self> = text.split(',').map(parse).collect();
        parsed.ok_or_else(|| "globs and weights with commas between, such as *Face*:4,Hair:0.5".into())
    }

    fn ron(&self) -> String {
        let item = |i: &MaterialWeight| format!("(material: {:?}, weight: {:?})", i.material, i.weight);
        format!("[{}]", self.iter().map(item).collect::<Vec<_>>().join(", "))
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let is_valid = |i: &MaterialWeight| i.weight.check(RANGE).is_ok() && i.matcher().is_some();
        if self.len() <= MOST && self.iter().all(is_valid) { Ok(()) } else { Err(Self::accepts(limit)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face() -> MaterialWeight {
        MaterialWeight { material: "*Face*".into(), weight: 4.0 }
    }

    #[test]
    fn importances_are_read_from_both_spellings() {
        let expected = vec![face(), MaterialWeight { material: "a:b".into(), weight: 0.5 }];
        assert_eq!(Vec::<MaterialWeight>::from_arg("*Face*:4, a:b:0.5"), Ok(expected.clone()));
        let ron = r#"[(material: "*Face*", weight: 4.0), (material: "a:b", weight: 0.5)]"#;
        assert_eq!(expected.ron(), ron);
        assert_eq!(ron::from_str::<Vec<MaterialWeight>>(ron).expect("valid"), expected);
        assert_eq!(Vec::<MaterialWeight>::from_arg(" "), Ok(Vec::new()));
        assert!(Vec::<MaterialWeight>::from_arg("*Face*").is_err());
    }

    #[test]
    fn weights_have_a_range_and_globs_a_grammar() {
        assert!(vec![face()].check(Limit::None).is_ok());
        for bad in [MaterialWeight { weight: 0.0, ..face() }, MaterialWeight { weight: f32::NAN, ..face() }] {
            assert!(vec![bad].check(Limit::None).is_err());
        }
        assert!(vec![MaterialWeight { material: "[".into(), ..face() }].check(Limit::None).is_err());
    }

    #[test]
    fn a_glob_finds_names() {
        let matcher = face().matcher().expect("sound");
        assert!(matcher.is_match("Head/FaceSkin") && !matcher.is_match("surface"));
    }
}
