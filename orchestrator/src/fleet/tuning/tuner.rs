//! The choice of the number of envs, from costs measured while the run goes on.
//!
//! More envs make larger batches, which cost less per query, and hide the time that a host takes to answer;
//! but they delay the first results, need memory, and make an interruption lose more. So the tuner starts
//! with few and tries more as long as that pays. From the costs during a trial it predicts the speed of the
//! run with that number of envs:
//!
//! cores · u / (s + (r + w) / k + t)
//!
//! with the fraction u that the children used of the core time that other programs left to them, the
//! core-seconds r of rendering and w of inference per query and t of everything else per control step, all
//! during the trial, and with the core-seconds s of physics per control step and the control steps k per
//! query of the whole run: episodes differ in these by task, not by the number of envs.
//!
//! The work of a GPU takes no core time, but u falls while the children wait for it. The prediction is then
//! the speed that the GPU permits, which grows only until its batches are full.
//!
//! While every env proceeds briskly, the first results are not delayed by more envs, and the tuner tries more
//! even without a predicted gain. In larger batches the same code works longer on the same data, which makes
//! physics cheaper, but hardly shows in a short trial. With 256 envs instead of 32, a sweep over all tasks
//! without images gained 2 % on one machine and 10 % on another.
//!
//! The number influences no result, only the order of the work.

use std::time::Duration;

use crate::fleet::tuning::env_choice::{EnvChoice, EnvTrial};
use crate::fleet::tuning::totals::{HostWork, Totals};

/// Time after a change of the number before the next trial begins, and the shortest trial.
const SETTLING: Duration = Duration::from_millis(100);
const MIN_TRIAL: Duration = Duration::from_millis(400);
/// Queries, or control steps of an env without queries, per env in a trial.
const MIN_QUERIES: u64 = 2;
const MIN_STEPS: u64 = 10;
/// Least gain for which the number grows.
const MIN_GAIN: f64 = 1.02;
/// Control steps per second from which an env proceeds briskly: 40 % of real time.
const BRISK_STEPS_PER_S: f64 = 8.0;
/// Fraction of the best predicted speed that suffices for brisk envs. A trial of half a second is often wrong
/// by a tenth.
const BRISK_MIN_SPEED: f64 = 0.85;
/// Utilisation below which the number grows by more than a factor of 2.
const LOW_UTILISATION: f64 = 0.5;
/// Fraction of the core time taken by other programs above which a trial counts as disturbed. The number then
/// grows only if that gains speed.
const DISTURBANCE: f64 = 0.1;
/// Time until a choice is checked again, doubled after every check that confirms it.
const FIRST_CHECK: Duration = Duration::from_secs(20);
const MAX_CHECK: Duration = Duration::from_secs(600);

/// Cumulative work of all children at a moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct WorkSample {
    /// Time of the fleet's clock.
    pub(crate) now: Duration,
    /// Core-seconds of all children.
    pub(crate) cpu_s: f64,
    /// Core-seconds in which the cores had nothing to do, where the system tells it.
    pub(crate) idle_s: Option<f64>,
    /// Core-seconds of the sims within their measured window.
    pub(crate) sim_cpu_s: f64,
    pub(crate) env_steps: u64,
    pub(crate) queries: u64,
    pub(crate) physics_s: f64,
    pub(crate) render_s: f64,
    /// By lane.
    pub(crate) hosts: Vec<HostWork>,
}

impl WorkSample {
    /// Makes the sample at `now`, when the children have used `cpu_s` core-seconds and the cores have been
    /// idle for `idle_s`.
    pub(crate) fn new(now: Duration, cpu_s: f64, idle_s: Option<f64>, totals: &Totals) -> Self {
        let sim = totals.sim();
        Self {
            now,
            cpu_s,
            idle_s,
            sim_cpu_s: sim.cpu_s,
            env_steps: sim.env_steps,
            queries: sim.queries,
            physics_s: sim.physics_s,
            render_s: sim.render_s,
            hosts: totals.lanes(),
        }
    }
}

#[derive(Debug)]
enum Phase {
    /// The number was changed or a child was started; the trial starts after a moment.
    Settling { since: Option<WorkSample> },
    /// The costs since this sample are measured.
    Trial { since: WorkSample },
    /// The number stays for a while.
    Chosen { until: Duration },
}

/// Chooses the number of envs.
#[derive(Debug)]
pub(crate) struct EnvTuner {
    choice: EnvChoice,
    n_cores: f64,
    phase: Phase,
    next_check: Duration,
}

impl EnvTuner {
    /// Makes a tuner that starts with `envs`.
    pub(crate) fn new(envs: u32, max_envs: u32, n_cores: u32) -> Self {
        Self {
            choice: EnvChoice { envs, max_envs, trials: Vec::new() },
            n_cores: f64::from(n_cores),
            phase: Phase::Settling { since: None },
            next_check: FIRST_CHECK,
        }
    }

    /// Returns the current choice.
    pub(crate) fn choice(&self) -> &EnvChoice {
        &self.choice
    }

    /// Halves the current number, which was too much for the memory, and does not go beyond it again.
    pub(crate) fn halve(&mut self) {
        self.choice.envs = (self.choice.envs / 2).max(1);
        self.choice.max_envs = self.choice.envs;
    }

    /// Starts the current trial again, because a child has exited or started.
    pub(crate) fn interrupt(&mut self) {
        if !matches!(self.phase, Phase::Chosen { .. }) {
            self.phase = Phase::Settling { since: None };
        }
    }

    /// Takes the work done so far. Returns the number of envs if it changes.
    pub(crate) fn on_work(&mut self, total: WorkSample) -> Option<u32> {
        if total.env_steps == 0 {
            return None;
        }
        match &self.phase {
            Phase::Settling { since: None } => self.phase = Phase::Settling { since: Some(total) },
            Phase::Settling { since: Some(start) } => {
                if self.is_enough(start, &total, SETTLING, 1) {
                    self.phase = Phase::Trial { since: total };
                }
            }
            Phase::Trial { since } => {
                if self.is_enough(since, &total, MIN_TRIAL, MIN_QUERIES) {
                    let trial = self.trial(since, &total);
                    return self.decide(trial, total.now);
                }
            }
            Phase::Chosen { until } => {
                if total.now >= *until {
                    self.choice.trials.clear();
                    self.phase = Phase::Trial { since: total };
                }
            }
        }
        None
    }

    /// Returns `true` if the work between two samples suffices: `rounds` queries of every env, or as many
    /// control steps where there are no queries.
    fn is_enough(&self, start: &WorkSample, end: &WorkSample, time: Duration, rounds: u64) -> bool {
        let envs = u64::from(self.choice.envs);
        let queries = end.queries - start.queries;
        let is_worked = if end.queries > 0 {
            queries >= rounds * envs
        } else {
            end.env_steps - start.env_steps >= rounds * envs * MIN_STEPS / MIN_QUERIES
        };
        is_worked && end.now - start.now >= time
    }

    /// Predicts the speed from the costs between two samples.
    fn trial(&self, start: &WorkSample, end: &WorkSample) -> EnvTrial {
        let per = |seconds: f64, count: u64| if count == 0 { 0.0 } else { seconds / count as f64 };
        let all_s = (end.now - start.now).as_secs_f64() * self.n_cores;
        let used_s = (end.cpu_s - start.cpu_s).clamp(0.0, all_s);
        // Within a quota, more cores may have been idle than the children may use.
        let idle_s = end.idle_s.zip(start.idle_s).map_or(all_s, |(end, start)| (end - start).max(0.0));
        let left_s = (used_s + idle_s).min(all_s);
        let utilisation = if left_s > 0.0 { used_s / left_s } else { 1.0 };
        let (steps, queries) = (end.env_steps - start.env_steps, end.queries - start.queries);
        let physics_s = end.physics_s - start.physics_s;
        let render_s = end.render_s - start.render_s;
        let step_s = per(end.physics_s, end.env_steps);
        let other_s = per((end.sim_cpu_s - start.sim_cpu_s - physics_s - render_s).max(0.0), steps);
        let all_queries: u64 = end.hosts.iter().map(|host| host.queries).sum();
        // Lanes have different costs: each counts by its share in the queries of the whole run.
        let inference_s: f64 = (0..end.hosts.len())
            .map(|lane| {
                let (before, after) = (start.hosts[lane], end.hosts[lane]);
                let (busy_s, n) = match after.queries - before.queries {
                    0 => (after.busy_s, after.queries),
                    n => (after.busy_s - before.busy_s, n),
                };
                per(after.queries as f64, all_queries) * per(busy_s, n)
            })
            .sum();
        let query_s = per(render_s, queries) + inference_s;
        let cost_s = step_s + query_s * per(end.queries as f64, end.env_steps) + other_s;
        EnvTrial {
            envs: self.choice.envs,
            predicted: self.n_cores * utilisation / cost_s.max(f64::MIN_POSITIVE),
            utilisation,
            foreign: 1.0 - left_s / all_s,
        }
    }

    /// Tries more envs if the last increase gained speed, or cost little and the envs stay brisk. Otherwise
    /// chooses among the good trials: the largest brisk number, or else the smallest.
    fn decide(&mut self, trial: EnvTrial, now: Duration) -> Option<u32> {
        let earlier = self.choice.trials.iter().map(|trial| trial.predicted).fold(0.0, f64::max);
        self.choice.trials.push(trial);
        let EnvChoice { envs, max_envs, trials } = &mut self.choice;
        let before = *envs;
        let factor = if trial.utilisation < LOW_UTILISATION { 4 } else { 2 };
        let more = envs.saturating_mul(factor).min(*max_envs);
        let is_brisk =
            |envs: u32| trial.foreign < DISTURBANCE && trial.predicted >= BRISK_STEPS_PER_S * f64::from(envs);
        let least = if is_brisk(more) { BRISK_MIN_SPEED } else { MIN_GAIN } * earlier;
        if trial.predicted > least && more > *envs {
            *envs = more;
            self.phase = Phase::Settling { since: None };
        } else {
            let best = trials.iter().map(|trial| trial.predicted).fold(0.0, f64::max);
            let of_best = |least: f64| {
                let good = trials.iter().filter(move |trial| trial.predicted >= least * best);
                good.map(|trial| trial.envs)
            };
            let brisk = of_best(BRISK_MIN_SPEED).filter(|envs| is_brisk(*envs)).max();
            *envs = brisk.or_else(|| of_best(1.0 / MIN_GAIN).min()).unwrap_or(before);
            self.phase = Phase::Chosen { until: now + self.next_check };
            self.next_check = (2 * self.next_check).min(MAX_CHECK);
        }
        (*envs != before).then_some(*envs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine of 2 cores whose costs follow a formula: an env-step takes 0.2 ms; a query takes `fixed_s`
    /// per batch of half of the envs, and `own_s` per env; the host sleeps for `sleep_s` per batch. A GPU,
    /// if there is one, takes `gpu_s` per query, but as long as for `gpu_width` queries for less of them.
    /// Other programs take the fraction `foreign` of the cores.
    struct FakeMachine {
        fixed_s: f64,
        own_s: f64,
        sleep_s: f64,
        gpu_s: f64,
        gpu_width: f64,
        foreign: f64,
        steps: f64,
        sample: WorkSample,
    }

    const STEPS_PER_QUERY: f64 = 30.0;

    impl FakeMachine {
        fn new(fixed_s: f64, own_s: f64, sleep_s: f64) -> Self {
            let sample =
                WorkSample { hosts: vec![HostWork::default()], idle_s: Some(0.0), ..WorkSample::default() };
            Self { fixed_s, own_s, sleep_s, gpu_s: 0.0, gpu_width: 1.0, foreign: 0.0, steps: 0.0, sample }
        }

        /// Control steps per second with this number of envs, and core-seconds per control step.
        fn speed(&self, envs: u32) -> (f64, f64) {
            let batch = f64::from(envs) / 2.0;
            let cost_s = 2e-4 + (self.fixed_s / batch + self.own_s) / STEPS_PER_QUERY;
            let wall_s = cost_s / (2.0 * (1.0 - self.foreign)) + self.sleep_s / batch / STEPS_PER_QUERY;
            let gpu_s = self.gpu_s * self.gpu_width.max(batch) / batch / STEPS_PER_QUERY;
            (1.0 / wall_s.max(gpu_s), cost_s)
        }

        fn run(&mut self, envs: u32, wall: Duration) {
            let (speed, cost_s) = self.speed(envs);
            let steps = speed * wall.as_secs_f64();
            self.steps += steps;
            let sample = &mut self.sample;
            sample.now += wall;
            sample.cpu_s += cost_s * steps;
            let left_s = 2.0 * (1.0 - self.foreign) * wall.as_secs_f64();
            sample.idle_s = sample.idle_s.map(|idle_s| idle_s + left_s - cost_s * steps);
            sample.sim_cpu_s += 2e-4 * steps;
            sample.physics_s += 2e-4 * steps;
            sample.env_steps = self.steps as u64;
            sample.queries = (self.steps / STEPS_PER_QUERY) as u64;
            let host = &mut sample.hosts[0];
            host.queries = sample.queries;
            host.busy_s += (cost_s - 2e-4) * steps;
        }

        /// Returns the numbers that a tuner goes through within `wall`.
        fn tuned(&mut self, wall: Duration) -> Vec<u32> {
            let mut tuner = EnvTuner::new(16, 256, 2);
            let mut numbers = vec![16];
            while self.sample.now < wall {
                self.run(*numbers.last().unwrap(), Duration::from_millis(100));
                numbers.extend(tuner.on_work(self.sample.clone()));
            }
            assert_eq!(tuner.choice().envs, *numbers.last().unwrap());
            numbers
        }
    }

    #[test]
    fn cost_per_batch_asks_for_more_envs() {
        let numbers = FakeMachine::new(0.02, 1e-3, 0.0).tuned(Duration::from_secs(15));
        assert_eq!(numbers[..3], [16, 32, 64]);
        let chosen = FakeMachine::new(0.02, 1e-3, 0.0).speed(*numbers.last().unwrap()).0;
        let best = FakeMachine::new(0.02, 1e-3, 0.0).speed(256).0;
        assert!(chosen > 0.95 * best, "{numbers:?}: {chosen} of {best}");
    }

    #[test]
    fn expensive_samples_keep_few_envs() {
        let numbers = FakeMachine::new(0.01, 0.4, 0.0).tuned(Duration::from_secs(40));
        assert_eq!(numbers, [16, 32, 16], "the second trial gains nothing");
    }

    #[test]
    fn brisk_envs_grow_without_gain() {
        let numbers = FakeMachine::new(0.0, 1e-4, 0.0).tuned(Duration::from_secs(15));
        assert_eq!(numbers, [16, 32, 64, 128, 256]);
        let numbers = FakeMachine::new(0.0, 0.1, 0.0).tuned(Duration::from_secs(15));
        assert_eq!(numbers, [16, 32, 64], "128 envs would proceed at 4 steps per second each");
    }

    #[test]
    fn foreign_load_is_no_idle_time() {
        let machine = |fixed_s| FakeMachine { foreign: 0.7, ..FakeMachine::new(fixed_s, 1e-4, 0.0) };
        let numbers = machine(0.0).tuned(Duration::from_secs(15));
        assert_eq!(numbers, [16, 32, 16], "more envs cannot get more of the cores");
        let numbers = machine(0.02).tuned(Duration::from_secs(15));
        assert_eq!(numbers[..3], [16, 32, 64], "larger batches save time all the same");
    }

    #[test]
    fn waiting_for_slow_host_asks_for_many_more() {
        let numbers = FakeMachine::new(0.0, 1e-4, 0.2).tuned(Duration::from_secs(15));
        assert_eq!(numbers, [16, 64, 256]);
    }

    #[test]
    fn envs_fill_batches_of_gpu_but_no_more() {
        let gpu = |gpu_s, gpu_width| FakeMachine { gpu_s, gpu_width, ..FakeMachine::new(0.0, 1e-4, 0.0) };
        let numbers = gpu(0.03, 32.0).tuned(Duration::from_secs(45));
        assert_eq!(numbers, [16, 64, 256, 64], "batches of 32 are full with 64 envs, two of them in flight");
        let numbers = gpu(0.1, 1.0).tuned(Duration::from_secs(30));
        assert_eq!(numbers, [16, 64, 16], "they are full with any number");
    }

    #[test]
    fn choice_is_checked_again() {
        let mut machine = FakeMachine::new(0.0, 0.4, 0.0);
        let mut tuner = EnvTuner::new(16, 256, 2);
        let mut numbers = Vec::new();
        let mut envs = 16;
        while machine.sample.now < Duration::from_secs(120) {
            machine.run(envs, Duration::from_millis(100));
            if let Some(count) = tuner.on_work(machine.sample.clone()) {
                envs = count;
                numbers.push(count);
            }
            // The sweep reaches tasks for which batches matter.
            if machine.sample.now > Duration::from_secs(40) {
                (machine.fixed_s, machine.own_s) = (0.05, 1e-3);
            }
        }
        assert_eq!(numbers[..2], [32, 16]);
        assert!(numbers.last().is_some_and(|envs| *envs >= 64), "{numbers:?}");
    }

    #[test]
    fn trial_starts_again_after_crash() {
        let mut machine = FakeMachine::new(0.02, 1e-3, 0.0);
        let mut tuner = EnvTuner::new(16, 256, 2);
        for _ in 0..100 {
            machine.run(16, Duration::from_millis(100));
            // The core-seconds of a new process start at 0.
            machine.sample.cpu_s = 0.0;
            tuner.interrupt();
            assert_eq!(tuner.on_work(machine.sample.clone()), None);
        }
        assert_eq!(tuner.choice().trials, []);
    }
}
