//! Location: tells which tier has a result, without fetching or checking its content.

use serde::{Deserialize, Serialize};

use crate::counters::add;
use crate::flight::Flight;
use crate::store::{Cache, Lookup};

/// A tier of a cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TierName {
    /// The folder of this machine.
    Local,
    /// The shared tier.
    Shared,
}

impl Cache {
    /// The first tier that has the result of a key: its record, and all its objects with their full sizes. No content is read,
    /// so the result may still turn out to be damaged. A failure of a tier is a notice and counts as a miss.
    pub fn locate(&self, flight: &Flight<'_>) -> Option<TierName> {
        match self.get_objects(flight.key, |_| false) {
            Lookup::Hit(_) => {
                add(&self.tally().hits, 1);
                return Some(TierName::Local);
            }
            Lookup::Damaged(error) => (flight.notify)(error.into()),
            Lookup::Miss => {}
        }
        add(&self.tally().misses, 1);
        match self.shared()?.has(flight) {
            Ok(is_there) => is_there.then_some(TierName::Shared),
            Err(error) => {
                (flight.notify)(error.into());
                None
            }
        }
    }
}
