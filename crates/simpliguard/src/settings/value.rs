//! The values of fields: ranges, spellings, checks.

/// The longest list of levels.
pub(super) const MAX_LEVELS: usize = 8;

/// The range of a field, ends included. In lists and variants it is the range of the numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Limit {
    /// Any value of the type.
    None,
    /// From the first to the second.
    Between(f64, f64),
    /// A power of two from the first to the second.
    PowerOfTwo(u32, u32),
}

impl Limit {
    pub(super) fn allows_whole(self, value: u32) -> bool {
        match self {
            Self::None => true,
            Self::Between(low, high) => (low..=high).contains(&f64::from(value)),
            Self::PowerOfTwo(low, high) => value.is_power_of_two() && (low..=high).contains(&value),
        }
    }

    /// The number in the range that is nearest to `value`.
    fn nearest(self, value: f64) -> Option<f64> {
        match self {
            Self::None => None,
            Self::Between(low, high) => Some(value.clamp(low, high)),
            Self::PowerOfTwo(low, high) => {
                let all = (low.trailing_zeros()..=high.trailing_zeros()).map(|bit| f64::from(1_u32 << bit));
                all.min_by(|a, b| (a - value).abs().total_cmp(&(b - value).abs()))
            }
        }
    }

    /// "from 1 to 16", after "a whole number" and the like.
    pub(super) fn words(self) -> String {
        match self {
            Self::None => String::new(),
            Self::Between(low, high) => format!(" from {low} to {high}"),
            Self::PowerOfTwo(low, high) => format!(" (a power of two) from {low} to {high}"),
        }
    }
}

/// A type of values that fields can have.
pub(super) trait Value: Sized {
    /// The values that may be written, in words: "a whole number from 1 to 16".
    fn accepts(limit: Limit) -> String;
    /// The value of a command-line spelling. `Err` says what was expected.
    fn from_arg(text: &str) -> Result<Self, String>;
    /// The RON spelling; each value has exactly one.
    fn ron(&self) -> String;
    /// Checks the range. `Err` says what was expected.
    fn check(&self, _: Limit) -> Result<(), String> {
        Ok(())
    }
    /// The nearest value in the range, if the type has one.
    fn nearest(&self, _: Limit) -> Option<Self> {
        None
    }
    /// Makes values that mean the same equal.
    fn normalised(self) -> Self {
        self
    }
}

impl Value for bool {
    fn accepts(_: Limit) -> String {
        "true or false".into()
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        text.trim().parse().map_err(|_| Self::accepts(Limit::None))
    }

    fn ron(&self) -> String {
        self.to_string()
    }
}

impl Value for u32 {
    fn accepts(limit: Limit) -> String {
        match limit {
            Limit::PowerOfTwo(low, high) => format!("a power of two from {low} to {high}"),
            limit => format!("a whole number{}", limit.words()),
        }
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        text.trim().parse().map_err(|_| "a whole number".into())
    }

    fn ron(&self) -> String {
        self.to_string()
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        if limit.allows_whole(*self) { Ok(()) } else { Err(Self::accepts(limit)) }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        limit.nearest(f64::from(*self)).map(|n| n as Self)
    }
}

impl Value for f32 {
    fn accepts(limit: Limit) -> String {
        format!("a number{}", limit.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        text.trim().parse().map_err(|_| "a number".into())
    }

    fn ron(&self) -> String {
        format!("{self:?}")
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let allowed = match limit {
            // The comparison is in single precision: the ends, as users write them, are in the range.
            Limit::Between(low, high) => (low as f32..=high as f32).contains(self),
            _ => self.is_finite(),
        };
        if allowed { Ok(()) } else { Err(Self::accepts(limit)) }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        limit.nearest(f64::from(*self)).map(|n| n as Self).filter(|n| n.is_finite())
    }

    fn normalised(self) -> Self {
        // -0 becomes 0.
        self + 0.0
    }
}

impl Value for Vec<u32> {
    fn accepts(limit: Limit) -> String {
        format!("1 to {MAX_LEVELS} whole numbers, each{}", limit.words())
    }

    fn from_arg(text: &str) -> Result<Self, String> {
        text.split(',')
            .map(u32::from_arg)
            .collect::<Result<_, _>>()
            .map_err(|_| "whole numbers with commas between".into())
    }

    fn ron(&self) -> String {
        format!("{self:?}")
    }

    fn check(&self, limit: Limit) -> Result<(), String> {
        let allowed = (1..=MAX_LEVELS).contains(&self.len()) && self.iter().all(|n| limit.allows_whole(*n));
        if allowed { Ok(()) } else { Err(Self::accepts(limit)) }
    }

    fn nearest(&self, limit: Limit) -> Option<Self> {
        let all: Option<Self> = self.iter().take(MAX_LEVELS).map(|n| n.nearest(limit)).collect();
        all.filter(|all| !all.is_empty())
    }

    fn normalised(mut self) -> Self {
        self.sort_unstable();
        self.dedup();
        self
    }
}

/// Declares an enum without data: PascalCase in RON, kebab-case on the command line.
macro_rules! choice {
    (
        $(#[$meta:meta])*
        pub enum $name:ident { $( $(#[$variant_meta:meta])* $variant:ident, )+ }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name { $( $(#[$variant_meta])* $variant, )+ }

        impl $crate::settings::value::Value for $name {
            fn accepts(_: $crate::settings::value::Limit) -> String {
                $crate::settings::value::one_of([$(stringify!($variant).to_owned()),+])
            }

            fn from_arg(text: &str) -> Result<Self, String> {
                use $crate::settings::value::{kebab, one_of};
                let text = text.trim();
                $(
                    // As in RON, or as is usual on a command line.
                    if text == stringify!($variant) || text == kebab(stringify!($variant)) {
                        return Ok(Self::$variant);
                    }
                )+
                Err(one_of([$(kebab(stringify!($variant))),+]))
            }

            fn ron(&self) -> String {
                match self { $( Self::$variant => stringify!($variant).to_owned(), )+ }
            }
        }
    };
}
pub(super) use choice;

/// "a, b or c".
pub(super) fn one_of<const N: usize>(choices: [String; N]) -> String {
    match choices.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => choices.concat(),
    }
}

/// Kebab case from Pascal case: `closest-surface` from `ClosestSurface`.
pub(super) fn kebab(pascal: &str) -> String {
    let mut out = String::with_capacity(pascal.len() + 4);
    for c in pascal.chars() {
        if c.is_ascii_uppercase() && !out.is_empty() {
            out.push('-');
        }
        out.push(c.to_ascii_lowercase());
    }
    out
}
