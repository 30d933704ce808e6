//! Totals of a fleet over all its child processes.

use sim::serve::protocol::Counters;

use crate::fleet::tuning::env_choice::EnvChoice;

/// Sums over all children, including those that have exited.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Totals {
    /// Sums over the sims that have exited.
    past: Counters,
    /// Counters of the current sim.
    current: Counters,
    /// Per lane: the sum over hosts that have exited, and the current host.
    hosts: Vec<[HostWork; 2]>,
    /// By lane: the name of the policy if its host is a foreign one.
    pub(crate) foreign: Vec<Option<String>>,
    /// Name of the renderer, known once a sim is ready.
    pub(crate) renderer: Option<String>,
    /// Identity of that renderer, or of the one that rendered earlier results.
    pub(crate) renderer_identity: Option<String>,
    /// Bytes of shared memory in use, known once a sim is ready.
    pub(crate) shm_bytes: u64,
    /// Largest sum of the children's own memory that was seen, in bytes; shared memory is not part of it.
    pub(crate) memory_bytes: u64,
    /// The number of envs and how it was chosen; `None` if the user fixed it.
    pub(crate) choice: Option<EnvChoice>,
    /// Number of children that were restarted.
    pub(crate) restarts: u32,
}

/// The work of policy hosts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct HostWork {
    /// Number of answered queries, one per env.
    pub(crate) queries: u64,
    /// Number of answered batches.
    pub(crate) batches: u64,
    /// Core-seconds of inference.
    pub(crate) busy_s: f64,
    /// Core-seconds of the whole processes since their first queries.
    pub(crate) cpu_s: f64,
    /// Wall seconds in which a device had a batch; over several lanes, those of the busiest.
    pub(crate) device_s: f64,
    /// Floating-point operations of inference.
    pub(crate) flop: u64,
}

impl Totals {
    /// Makes the totals of a fleet without children.
    pub(crate) fn new(n_lanes: usize, renderer_identity: Option<String>) -> Self {
        Self { hosts: vec![Default::default(); n_lanes], renderer_identity, ..Self::default() }
    }

    /// Returns the sum over all sims.
    pub(crate) fn sim(&self) -> Counters {
        add(&self.past, &self.current)
    }

    /// Returns the number of control steps and queries of all children, which grows while any of them works.
    pub(crate) fn work(&self) -> u64 {
        let answered: u64 = self.lanes().iter().map(|work| work.queries).sum();
        let Counters { env_steps, queries, .. } = self.sim();
        env_steps + queries + answered
    }

    /// Returns the sum over all policy hosts, for the queries whose answers the sim received. A run that is
    /// stopped does not wait for the others; their share of the core-seconds is estimated by their number.
    pub(crate) fn hosts(&self) -> HostWork {
        let lanes = self.lanes();
        let device_s = lanes.iter().map(|work| work.device_s).fold(0.0, f64::max);
        let all = lanes.into_iter().fold(HostWork::default(), HostWork::add);
        let all = HostWork { device_s, ..all };
        let received = self.past.latencies.count() + self.current.latencies.count();
        if received >= all.queries {
            return all;
        }
        let fraction = received as f64 / all.queries as f64;
        HostWork {
            queries: received,
            batches: all.batches,
            busy_s: all.busy_s * fraction,
            cpu_s: all.cpu_s * fraction,
            device_s: all.device_s * fraction,
            flop: (all.flop as f64 * fraction) as u64,
        }
    }

    /// Returns the core-seconds of inference of the busiest policy host, answers that were not received
    /// included.
    pub(crate) fn busiest_host_s(&self) -> f64 {
        self.lanes().iter().map(|work| work.busy_s).fold(0.0, f64::max)
    }

    /// Returns the policies with foreign hosts, and the seconds in which these had an unanswered query.
    pub(crate) fn foreign_hosts(&self) -> Vec<(String, f64)> {
        let names = self.foreign.iter().cloned().zip(self.sim().foreign_s);
        names.filter_map(|(name, seconds)| Some((name?, seconds))).collect()
    }

    /// Returns the work of each lane's hosts so far, answers that were not received included.
    pub(crate) fn lanes(&self) -> Vec<HostWork> {
        self.hosts.iter().map(|[past, current]| past.add(*current)).collect()
    }

    /// Updates the counters of the current sim.
    pub(crate) fn on_sim_counters(&mut self, counters: Counters) {
        self.current = counters;
    }

    /// Updates the work of the current host of a lane.
    pub(crate) fn on_host_work(&mut self, lane: u32, work: HostWork) {
        self.hosts[lane as usize][1] = work;
    }

    pub(crate) fn on_sim_exit(&mut self) {
        self.past = add(&self.past, &std::mem::take(&mut self.current));
        self.restarts += 1;
    }

    pub(crate) fn on_host_exit(&mut self, lane: u32) {
        let [past, current] = &mut self.hosts[lane as usize];
        *past = past.add(std::mem::take(current));
        self.restarts += 1;
    }
}

impl HostWork {
    fn add(self, other: Self) -> Self {
        Self {
            queries: self.queries + other.queries,
            batches: self.batches + other.batches,
            busy_s: self.busy_s + other.busy_s,
            cpu_s: self.cpu_s + other.cpu_s,
            device_s: self.device_s + other.device_s,
            flop: self.flop + other.flop,
        }
    }
}

fn add(a: &Counters, b: &Counters) -> Counters {
    let mut latencies = a.latencies.clone();
    latencies.add(&b.latencies);
    let at = |seconds: &[f64], lane: usize| seconds.get(lane).copied().unwrap_or(0.0);
    let n_lanes = a.foreign_s.len().max(b.foreign_s.len());
    let foreign_s = (0..n_lanes).map(|lane| at(&a.foreign_s, lane) + at(&b.foreign_s, lane)).collect();
    Counters {
        env_steps: a.env_steps + b.env_steps,
        images: a.images + b.images,
        queries: a.queries + b.queries,
        wall_s: a.wall_s + b.wall_s,
        physics_s: a.physics_s + b.physics_s,
        render_s: a.render_s + b.render_s,
        device_s: a.device_s + b.device_s,
        idle_s: a.idle_s + b.idle_s,
        cpu_s: a.cpu_s + b.cpu_s,
        foreign_s,
        latencies,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counters of a sim that received `n` answers.
    fn answered(n: u64) -> Counters {
        let mut counters = Counters::default();
        counters.latencies.record(std::time::Duration::from_millis(1), n);
        counters
    }

    #[test]
    fn work_for_lost_answers_does_not_count() {
        let mut totals = Totals::new(1, None);
        totals.on_sim_counters(answered(3));
        totals.on_host_work(
            0,
            HostWork { queries: 4, batches: 1, busy_s: 2.0, cpu_s: 4.0, device_s: 1.0, flop: 8 },
        );
        let work = totals.hosts();
        assert_eq!((work.queries, work.busy_s, work.cpu_s, work.device_s, work.flop), (3, 1.5, 3.0, 0.75, 6));
    }

    #[test]
    fn time_of_foreign_hosts_adds_up_over_sims() {
        let mut totals = Totals::new(2, None);
        totals.foreign = vec![None, Some("mine".to_owned())];
        let counters = |seconds| Counters { foreign_s: vec![0.0, seconds], ..Counters::default() };
        totals.on_sim_counters(counters(0.5));
        totals.on_sim_exit();
        assert_eq!(totals.foreign_hosts(), [("mine".to_owned(), 0.5)]);
        totals.on_sim_counters(counters(0.25));
        assert_eq!(totals.foreign_hosts(), [("mine".to_owned(), 0.75)]);
    }

    #[test]
    fn exited_children_are_counted_once() {
        let mut totals = Totals::new(1, None);
        let steps = |env_steps| Counters { env_steps, ..Counters::default() };
        totals.on_sim_counters(steps(5));
        totals.on_sim_counters(steps(7));
        totals.on_sim_exit();
        totals.on_sim_counters(steps(2));
        assert_eq!(totals.sim().env_steps, 9);
        let work = |queries| HostWork { queries, ..HostWork::default() };
        totals.on_sim_counters(answered(7));
        totals.on_host_work(0, work(3));
        totals.on_host_exit(0);
        totals.on_host_work(0, work(4));
        assert_eq!((totals.hosts().queries, totals.restarts), (7, 2));
    }
}
