//! How fast a tier answers, and whether it has fallen silent.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time without an answer after which a tier of which nothing is known is silent.
const LEAST: Duration = Duration::from_secs(1);
/// A tier is silent after this many times its slowest answer so far.
const FACTOR: u32 = 8;

/// The requests that wait for an answer, and the slowest answer so far.
#[derive(Debug, Default)]
pub(crate) struct Pulse(Mutex<Waits>);

#[derive(Debug, Default)]
struct Waits {
    next: u64,
    /// Begin of each request, and the time that its bytes may take.
    waiting: BTreeMap<u64, (Instant, Duration)>,
    slowest: Duration,
}

/// A request that waits for its answer until it is dropped.
pub(crate) struct Wait<'a> {
    pulse: &'a Pulse,
    id: u64,
}

impl Pulse {
    /// Notes the begin of a request whose bytes may take a time.
    pub(crate) fn wait(&self, transfer: Duration) -> Wait<'_> {
        let mut waits = self.waits();
        let id = waits.next;
        waits.next += 1;
        waits.waiting.insert(id, (Instant::now(), transfer));
        Wait { pulse: self, id }
    }

    /// The longest time that a request has waited for more than its bytes.
    pub(crate) fn longest_wait(&self) -> Duration {
        self.waits().longest()
    }

    /// The time for which the tier has been silent, if that is much longer than its answers took so far.
    pub(crate) fn silence(&self) -> Option<Duration> {
        let waits = self.waits();
        let (longest, limit) = (waits.longest(), LEAST.max(FACTOR * waits.slowest));
        (longest >= limit).then_some(longest)
    }

    fn waits(&self) -> MutexGuard<'_, Waits> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waits {
    fn longest(&self) -> Duration {
        let waits = self.waiting.values().map(|(begin, transfer)| begin.elapsed().saturating_sub(*transfer));
        waits.max().unwrap_or_default()
    }
}

impl Wait<'_> {
    /// Notes that the answer is there.
    pub(crate) fn answered(self) {
        let mut waits = self.pulse.waits();
        if let Some((begin, transfer)) = waits.waiting.remove(&self.id) {
            waits.slowest = waits.slowest.max(begin.elapsed().saturating_sub(transfer));
        }
    }
}

impl Drop for Wait<'_> {
    fn drop(&mut self) {
        self.pulse.waits().waiting.remove(&self.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pulse with a request that began so long ago, whose bytes may take a second.
    fn pulse(seconds: f32, slowest: f32) -> Pulse {
        let begin = Instant::now().checked_sub(Duration::from_secs_f32(seconds)).expect("the clock runs for longer");
        let waiting = BTreeMap::from([(0, (begin, Duration::from_secs(1)))]);
        Pulse(Mutex::new(Waits { next: 1, waiting, slowest: Duration::from_secs_f32(slowest) }))
    }

    #[test]
    fn a_tier_is_silent_after_a_multiple_of_its_slowest_answer() {
        assert_eq!(Pulse::default().silence(), None);
        assert_eq!(pulse(1.5, 0.0).silence(), None);
        assert!(pulse(2.5, 0.0).silence().is_some_and(|time| time >= Duration::from_millis(1500)));
        assert_eq!(pulse(2.5, 0.5).silence(), None);
        assert!(pulse(5.5, 0.5).silence().is_some());
    }

    #[test]
    fn an_answer_ends_the_wait_and_sets_the_measure() {
        let pulse = pulse(3.0, 0.0);
        assert!(pulse.silence().is_some());
        Wait { pulse: &pulse, id: 0 }.answered();
        assert_eq!((pulse.silence(), pulse.longest_wait()), (None, Duration::ZERO));
        assert!(pulse.waits().slowest >= Duration::from_secs(2));
        drop(pulse.wait(Duration::ZERO));
        assert!(pulse.waits().waiting.is_empty());
    }
}
