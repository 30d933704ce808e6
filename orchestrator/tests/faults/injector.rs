//! The source of chance in a simulated run: which faults strike when, and all durations.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use sim::scene::stream::Stream;

use super::scenario::{FaultKind, FaultScenario};

/// A random stream that knows the faults of a scenario.
pub(crate) struct FaultInjector {
    stream: Stream,
    chances: BTreeMap<FaultKind, f64>,
    end: Duration,
    /// The kinds that have struck.
    pub(crate) struck: BTreeSet<FaultKind>,
}

impl FaultInjector {
    /// Makes a stream without faults.
    pub(crate) fn new(seed: u64, name: &str) -> Self {
        Self {
            stream: Stream::new(seed, name),
            chances: BTreeMap::new(),
            end: Duration::ZERO,
            struck: BTreeSet::new(),
        }
    }

    /// Makes the stream of a scenario's run.
    pub(crate) fn of(scenario: &FaultScenario) -> Self {
        let (chances, end) = (scenario.chances.clone(), scenario.faults_end);
        Self { chances, end, ..Self::new(scenario.seed, "run") }
    }

    /// Returns `true` if a fault of this kind strikes at this opportunity.
    pub(crate) fn strikes(&mut self, kind: FaultKind, now: Duration) -> bool {
        let chance = self.chances.get(&kind).filter(|_| now < self.end);
        let strikes = chance.is_some_and(|&chance| self.stream.unit() < chance);
        if strikes {
            self.struck.insert(kind);
        }
        strikes
    }

    pub(crate) fn unit(&mut self) -> f64 {
        self.stream.unit()
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.stream.unit() < probability
    }

    /// Draws an integer from `min` to `max`, both included.
    pub(crate) fn number(&mut self, min: u64, max: u64) -> u64 {
        min + (self.stream.unit() * (max - min + 1) as f64) as u64
    }

    /// Draws a duration from `min` to `max` milliseconds.
    pub(crate) fn millis(&mut self, min: u64, max: u64) -> Duration {
        Duration::from_micros(self.number(min * 1000, max * 1000))
    }

    pub(crate) fn choose<T: Copy>(&mut self, all: &[T]) -> T {
        *self.stream.choose(all)
    }
}
