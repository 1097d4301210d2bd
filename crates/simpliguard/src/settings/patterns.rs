//! Values of the field `objects`.

use super::value::{Limit, Value};
use crate::data::NodePattern;

/// Most entries of the list.
const MOST: usize = 64;

impl Value for Vec<NodePattern> {
    fn accepts(_: Limit) -> String {
        format!("at most {MOST} globs over the names of nodes")
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        let patterns = text.split(',').map(str::trim).filter(|pattern| !pattern.is_empty());
        Ok(patterns.map(|pattern| NodePattern(pattern.to_owned())).collect())
    }

    fn ron(&self) -> String {
        format!("{:?}", self.iter().map(|NodePattern(glob)| glob).collect::<Vec<_>>())
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let allowed = self.len() <= MOST && self.iter().all(|pattern| pattern.matcher().is_some());
        if allowed { Ok(()) } else { Err(Self::accepts(limit)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_read_from_both_spellings() {
        let expected = vec![NodePattern("Lamp*".into()), NodePattern("Door?".into())];
        assert_eq!(Vec::<NodePattern>::from_arg("Lamp*, Door?"), Ok(expected.clone()));
        assert_eq!(expected.ron(), r#"["Lamp*", "Door?"]"#);
        assert_eq!(ron::from_str::<Vec<NodePattern>>(&expected.ron()).expect("valid"), expected);
        assert_eq!(Vec::<NodePattern>::from_arg(" "), Ok(Vec::new()));
    }

    #[test]
    fn patterns_are_few_and_have_a_grammar() {
        let pattern = |glob: &str| NodePattern(glob.into());
        assert!(vec![pattern("Lamp*"); MOST].check(Limit::None).is_ok());
        assert!(vec![pattern("Lamp*"); MOST + 1].check(Limit::None).is_err());
        assert!(vec![pattern("[")].check(Limit::None).is_err());
    }
}
