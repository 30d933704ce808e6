//! What a fleet has done so far, over all the children it has had.

use sim::serve::protocol::Counters;

/// Sums over all children, the dead ones included.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Totals {
    /// Of the sims that died.
    past: Counters,
    /// Of the sim that lives.
    current: Counters,
    /// Per lane: of the hosts that died, and of the one that lives.
    hosts: Vec<[HostWork; 2]>,
    /// Name of the renderer, once a sim is ready.
    pub(crate) renderer: Option<String>,
    /// Its identity, or that of the one that earlier results depend on.
    pub(crate) drawn_with: Option<String>,
    /// Bytes of shared memory in use, once a sim is ready.
    pub(crate) shm_bytes: u64,
    /// Children that had to be started again.
    pub(crate) restarts: u32,
}

/// What policy hosts have done.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct HostWork {
    /// Envs answered.
    pub(crate) queries: u64,
    /// Batches answered.
    pub(crate) batches: u64,
    /// Core-seconds spent answering.
    pub(crate) busy_s: f64,
}

impl Totals {
    /// Of no children yet.
    pub(crate) fn new(n_lanes: usize, drawn_with: Option<String>) -> Self {
        Self { hosts: vec![Default::default(); n_lanes], drawn_with, ..Self::default() }
    }

    /// Of all sims.
    pub(crate) fn sim(&self) -> Counters {
        add(self.past, self.current)
    }

    /// Of all policy hosts.
    pub(crate) fn hosts(&self) -> HostWork {
        self.hosts.iter().flatten().copied().fold(HostWork::default(), HostWork::plus)
    }

    /// The sim that lives has counted.
    pub(crate) fn sim_reports(&mut self, counters: Counters) {
        self.current = counters;
    }

    /// The host that lives has counted.
    pub(crate) fn host_reports(&mut self, lane: u32, work: HostWork) {
        self.hosts[lane as usize][1] = work;
    }

    pub(super) fn sim_died(&mut self) {
        self.past = add(self.past, std::mem::take(&mut self.current));
        self.restarts += 1;
    }

    pub(super) fn host_died(&mut self, lane: u32) {
        let [past, current] = &mut self.hosts[lane as usize];
        *past = past.plus(std::mem::take(current));
        self.restarts += 1;
    }
}

impl HostWork {
    fn plus(self, other: Self) -> Self {
        Self {
            queries: self.queries + other.queries,
            batches: self.batches + other.batches,
            busy_s: self.busy_s + other.busy_s,
        }
    }
}

fn add(a: Counters, b: Counters) -> Counters {
    Counters {
        env_steps: a.env_steps + b.env_steps,
        images: a.images + b.images,
        queries: a.queries + b.queries,
        wall_s: a.wall_s + b.wall_s,
        physics_s: a.physics_s + b.physics_s,
        render_s: a.render_s + b.render_s,
        idle_s: a.idle_s + b.idle_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dead_are_counted_once() {
        let mut totals = Totals::new(1, None);
        let steps = |env_steps| Counters { env_steps, ..Counters::default() };
        totals.sim_reports(steps(5));
        totals.sim_reports(steps(7));
        totals.sim_died();
        totals.sim_reports(steps(2));
        assert_eq!(totals.sim().env_steps, 9);
        let work = |queries| HostWork { queries, ..HostWork::default() };
        totals.host_reports(0, work(3));
        totals.host_died(0);
        totals.host_reports(0, work(4));
        assert_eq!((totals.hosts().queries, totals.restarts), (7, 2));
    }
}
