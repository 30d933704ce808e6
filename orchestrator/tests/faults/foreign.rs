//! Simulated foreign hosts: they come, hang and leave without the orchestrator's doing.

use std::time::Duration;

use super::injector::FaultInjector;
use super::scenario::FaultKind;
use super::sim::LaneHost;
use crate::plan::lanes::PolicyLane;

/// The foreign hosts, by lane.
pub(crate) struct ForeignHosts(Vec<Option<ForeignHost>>);

struct ForeignHost {
    id: u64,
    /// `None` if it never comes.
    present_from: Option<Duration>,
    answers_from: Duration,
    now: Duration,
}

impl ForeignHosts {
    pub(crate) fn new(lanes: &[PolicyLane], draw: &mut FaultInjector) -> Self {
        let mut host = || {
            let is_absent = draw.strikes(FaultKind::ForeignAbsent, Duration::ZERO);
            let present_from = (!is_absent).then(|| draw.millis(0, 2_000));
            ForeignHost { id: 0, present_from, answers_from: Duration::ZERO, now: Duration::ZERO }
        };
        Self(lanes.iter().map(|policy| policy.lane.foreign.then(&mut host)).collect())
    }

    pub(crate) fn tick(&mut self, now: Duration, draw: &mut FaultInjector) {
        for host in self.0.iter_mut().flatten() {
            host.now = now;
            if host.present_from.is_none_or(|from| now < from) {
                continue;
            }
            if draw.strikes(FaultKind::ForeignLeaves, now) {
                host.id += 1;
                host.present_from = Some(now + draw.millis(0, 3_000));
                host.answers_from = now;
            }
            if draw.strikes(FaultKind::ForeignHangs, now) {
                host.answers_from = now + draw.millis(500, 8_000);
            }
        }
    }

    /// Returns the host that a lane connects the sim to.
    pub(crate) fn get(&self, lane: u32) -> Option<LaneHost> {
        let host = self.0[lane as usize].as_ref()?;
        let is_present = host.present_from.is_some_and(|from| host.now >= from);
        let answers = host.now >= host.answers_from;
        is_present.then_some(LaneHost { id: host.id, answers, is_slow: false })
    }
}
