//! Values of the field `whole`.

use serde::{Deserialize, Serialize};

use super::value::{Limit, MAX_LEVELS, Value};

/// Largest numbers of triangles of some levels, ascending. There may be none.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Budgets(pub Vec<u32>);

impl Value for Budgets {
    fn accepts(limit: Limit) -> String {
        format!("at most {MAX_LEVELS} whole numbers, each{}", limit.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() { Ok(Self::default()) } else { Vec::from_arg(text).map(Self) }
    }

    fn ron(&self) -> String {
        self.0.ron()
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let allowed = self.0.is_empty() || self.0.check(limit).is_ok();
        if allowed { Ok(()) } else { Err(Self::accepts(limit)) }
    }

    fn normalised(self) -> Self {
        Self(self.0.normalised())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_may_be_none() {
        let limit = Limit::Between(4.0, 1e6);
        assert_eq!(Budgets::from_arg(" "), Ok(Budgets::default()));
        assert_eq!(Budgets::from_arg("4000,1000").map(Value::normalised), Ok(Budgets(vec![1000, 4000])));
        assert_eq!(ron::from_str::<Budgets>("[1000, 4000]").expect("valid").ron(), "[1000, 4000]");
        let check = |all: &[u32]| Budgets(all.to_vec()).check(limit);
        assert_eq!((check(&[]), check(&[4])), (Ok(()), Ok(())));
        let expected = "at most 8 whole numbers, each from 4 to 1000000";
        assert_eq!([check(&[3]), check(&[9; 9])], [(); 2].map(|()| Err(expected.to_owned())));
    }
}
