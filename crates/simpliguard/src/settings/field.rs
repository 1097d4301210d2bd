//! One field: its documentation, its built-in values, and the reading of its value.

use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error as _};

use super::choices::Quality;
use super::value::{Limit, Value};

/// The built-in value of a field at each quality.
pub(super) struct PerQuality<T> {
    draft: T,
    standard: T,
    best: T,
}

impl<T> PerQuality<T> {
    pub(super) fn of(self, quality: Quality) -> T {
        match quality {
            Quality::Draft => self.draft,
            Quality::Standard => self.standard,
            Quality::Best => self.best,
        }
    }
}

/// The same built-in value at every quality.
pub(super) fn always<T: Clone>(value: T) -> PerQuality<T> {
    PerQuality { draft: value.clone(), standard: value.clone(), best: value }
}

/// Built-in values that differ with the quality.
pub(super) fn by_quality<T>(draft: T, standard: T, best: T) -> PerQuality<T> {
    PerQuality { draft, standard, best }
}

/// The documentation of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldInfo {
    /// The name, as in RON and after `--set`.
    pub name: &'static str,
    /// The meaning, in one or more sentences.
    pub doc: String,
    /// The type of its values, with their range or the choices.
    pub accepts: String,
    /// Built-in values as RON for the qualities draft, standard and best.
    pub defaults: [String; 3],
}

impl FieldInfo {
    /// True if the built-in value depends on the quality.
    pub fn is_preset(&self) -> bool {
        self.defaults.iter().any(|d| *d != self.defaults[0])
    }
}

/// `Err` says that the value of the field `name` is out of range, and names the nearest value.
pub(super) fn check<T: Value>(name: &str, value: &T, limit: Limit) -> Result<(), String> {
    value.check(limit).map_err(|expected| {
        let nearest = value.nearest(limit).map(|n| format!("; the nearest is {}", n.ron())).unwrap_or_default();
        format!("{name}: {} is out of range: expected {expected}{nearest}", value.ron())
    })
}

/// Reads the value of a field and checks it at once, so that an error has the position of the value.
pub(super) struct ValueSeed<T> {
    name: &'static str,
    limit: Limit,
    value: PhantomData<T>,
}

impl<T> ValueSeed<T> {
    pub(super) fn new(name: &'static str, limit: Limit) -> Self {
        Self { name, limit, value: PhantomData }
    }
}

impl<'de, T: Value + Deserialize<'de>> DeserializeSeed<'de> for ValueSeed<T> {
    type Value = T;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<T, D::Error> {
        let name = self.name;
        let explained = |e| D::Error::custom(format!("{name}: expected {} ({e})", T::accepts(self.limit)));
        let value = T::deserialize(deserializer).map_err(explained)?;
        check(name, &value, self.limit).map_err(D::Error::custom)?;
        Ok(value)
    }
}
