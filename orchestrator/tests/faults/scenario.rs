//! The scenario of a seed: the fleet, its episodes, the faults that may strike, and the user's requests.

use std::collections::BTreeMap;
use std::sync::LazyLock;
use std::time::Duration;

use ipc_types::Morphology;
use ipc_types::link::LaneSpec;
use policy_host::PolicySpec;
use run_config::{Execution, RunConfig};
use sim::Perturbation;
use sim::serve::protocol::{Driver, Lane};
use sim::tasks::TaskId;

use super::super::{FleetConfig, Limits};
use super::injector::FaultInjector;
use crate::plan::capacity::Capacity;
use crate::plan::jobs::Job;
use crate::plan::lanes::PolicyLane;
use crate::plan::sweep::SweepArgs;
use crate::selection::condition::Condition;

/// Identity of the usual renderer.
pub(crate) const RENDERER: &str = "cpu";

/// The options of every run, which matter to no supervisor.
static RUN: LazyLock<RunConfig> = LazyLock::new(|| SweepArgs::parse("--threads 1").unwrap().config);

/// Kinds of faults. Each may strike at certain opportunities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum FaultKind {
    /// A child never gets ready.
    Mute,
    /// A child exits before it is ready.
    CrashAtStart,
    /// A child exits before it is ready, for a reason that the user can fix.
    UserError,
    /// A sim cannot open its renderer, or loses it later.
    RendererFails,
    /// A sim has another renderer than those before.
    RendererChanges,
    /// A ready child exits or is killed.
    Crash,
    /// A ready child does nothing any more.
    Hang,
    /// A ready child does nothing for a while.
    Suspend,
    /// A child's stdout closes long before it exits.
    Linger,
    /// A host answers so slowly that the sim has nothing to do meanwhile.
    SlowHost,
    /// A line on a pipe is lost.
    LoseLine,
    /// A line on a pipe arrives twice.
    DuplicateLine,
    /// A line on a pipe is truncated.
    TruncateLine,
    /// A line on a pipe is late, and those after it.
    DelayLine,
    /// A foreign host never comes.
    ForeignAbsent,
    /// A foreign host leaves and another one comes.
    ForeignLeaves,
    /// A foreign host does not answer for a while.
    ForeignHangs,
    /// The system does not start a child.
    SpawnFails,
    /// Freeing the memory of a child takes long.
    SlowCleanup,
    /// The orchestrator is suspended.
    Pause,
    /// Another user's files are found when a child has exited.
    Intruder,
    /// A resource has run out when a child has exited.
    Shortage,
    /// A ready sim goes on reporting, but no episode proceeds any more.
    Stall,
    /// The kernel kills a ready child for lack of memory.
    OutOfMemory,
    /// A file of the run is removed.
    Vanish,
}

/// All kinds, each with its probability per opportunity before it is scaled.
pub(crate) const FAULTS: [(FaultKind, f64); 25] = [
    (FaultKind::Mute, 0.1),
    (FaultKind::CrashAtStart, 0.1),
    (FaultKind::UserError, 0.04),
    (FaultKind::RendererFails, 0.004),
    (FaultKind::RendererChanges, 0.1),
    (FaultKind::Crash, 0.008),
    (FaultKind::Hang, 0.004),
    (FaultKind::Suspend, 0.01),
    (FaultKind::Linger, 0.3),
    (FaultKind::SlowHost, 0.3),
    (FaultKind::LoseLine, 0.03),
    (FaultKind::DuplicateLine, 0.03),
    (FaultKind::TruncateLine, 0.03),
    (FaultKind::DelayLine, 0.01),
    (FaultKind::ForeignAbsent, 0.2),
    (FaultKind::ForeignLeaves, 0.05),
    (FaultKind::ForeignHangs, 0.01),
    (FaultKind::SpawnFails, 0.1),
    (FaultKind::SlowCleanup, 0.2),
    (FaultKind::Pause, 0.003),
    (FaultKind::Intruder, 0.05),
    (FaultKind::Shortage, 0.1),
    (FaultKind::Stall, 0.004),
    (FaultKind::OutOfMemory, 0.008),
    (FaultKind::Vanish, 0.05),
];

/// Everything about a run that its seed determines before it starts.
pub(crate) struct FaultScenario {
    pub(crate) seed: u64,
    pub(crate) config: FleetConfig,
    pub(crate) jobs: Vec<Job>,
    /// Indices of the jobs that are unwanted when their turn comes.
    pub(crate) unwanted: Vec<usize>,
    /// Probability per opportunity of those kinds that may strike.
    pub(crate) chances: BTreeMap<FaultKind, f64>,
    /// Virtual time after which no fault strikes.
    pub(crate) faults_end: Duration,
    /// Virtual times at which the user requests a stop.
    pub(crate) stops: Vec<Duration>,
    /// Number of reports to the observer before the disk is full.
    pub(crate) disk_full_after: Option<u64>,
    /// Longest duration of an episode that nothing interrupts.
    pub(crate) longest_ms: u64,
}

impl FaultScenario {
    pub(crate) fn new(seed: u64) -> Self {
        let mut draw = FaultInjector::new(seed, "scenario");
        let drivers = drivers(&mut draw);
        let longest_ms = draw.choose(&[300, 1_200, 6_000, 20_000]);
        let n_episodes = (60_000 / longest_ms).min(40 / drivers.len() as u64);
        let episodes = draw.number(1, n_episodes) as u32;
        let jobs = jobs(&drivers, episodes);
        let few_unwanted = draw.chance(0.1);
        let unwanted = (0..jobs.len()).filter(|_| few_unwanted && draw.chance(0.3)).collect();
        let chances = chances(&mut draw);
        let disk_full = !chances.is_empty() && draw.chance(0.04);
        let n_stops = [0, 1, 2][usize::from(draw.chance(0.1)) + usize::from(draw.chance(0.06))];
        let last_fault_ms = if draw.chance(0.2) { 60_000 } else { 20_000 };
        let config = config(seed, &drivers, &mut draw);
        Self {
            seed,
            config,
            jobs,
            unwanted,
            faults_end: draw.millis(500, last_fault_ms),
            stops: (0..n_stops).map(|_| draw.millis(0, 8_000)).collect(),
            disk_full_after: disk_full.then(|| draw.number(0, 150)),
            longest_ms,
            chances,
        }
    }

    /// Returns `true` if nothing unusual happens.
    pub(crate) fn is_quiet(&self) -> bool {
        self.chances.is_empty() && self.stops.is_empty()
    }

    pub(crate) fn is_wanted(&self, job: &Job) -> bool {
        !self.unwanted.iter().any(|&idx| self.jobs[idx] == *job)
    }

    pub(crate) fn n_wanted(&self) -> usize {
        self.jobs.len() - self.unwanted.len()
    }
}

/// A driver and, for a lane, `true` if its host is foreign.
type DriverChoice = (Driver, bool);

fn drivers(draw: &mut FaultInjector) -> Vec<DriverChoice> {
    let n_hosted = draw.number(0, 2) as usize;
    let n_foreign = usize::from(draw.chance(0.3));
    let mut foreign = [vec![false; n_hosted], vec![true; n_foreign]].concat();
    if draw.chance(0.5) {
        foreign.reverse();
    }
    let mut drivers: Vec<DriverChoice> =
        (0..).zip(foreign).map(|(lane, foreign)| (Driver::Lane(lane), foreign)).collect();
    if drivers.is_empty() || draw.chance(0.5) {
        drivers.insert(draw.number(0, drivers.len() as u64) as usize, (Driver::Expert, false));
    }
    drivers
}

fn jobs(drivers: &[DriverChoice], episodes: u32) -> Vec<Job> {
    let job = |episode, policy_idx: usize| Job {
        policy_idx,
        condition: Condition {
            task: TaskId::ALL[episode as usize % 2],
            perturbation: Perturbation::ALL[episode as usize % 3].into(),
        },
        episode,
        seed: u64::from(episode) * 7 + 1,
        driver: drivers[policy_idx].0,
    };
    (0..episodes).flat_map(|episode| (0..drivers.len()).map(move |idx| job(episode, idx))).collect()
}

/// Draws the kinds that may strike: none, one or several, and how often.
fn chances(draw: &mut FaultInjector) -> BTreeMap<FaultKind, f64> {
    let share = draw.unit();
    let only = draw.number(0, FAULTS.len() as u64 - 1) as usize;
    let mut chances = BTreeMap::new();
    for (idx, (kind, chance)) in FAULTS.into_iter().enumerate() {
        let is_on = match share {
            0.0..0.1 => false,
            0.1..0.45 => idx == only,
            0.45..0.8 => draw.chance(0.2),
            _ => draw.chance(0.5),
        };
        if is_on {
            let scale = [0.25, 1.0, 3.0][draw.number(0, 2) as usize];
            chances.insert(kind, chance * scale);
        }
    }
    chances
}

fn config(seed: u64, drivers: &[DriverChoice], draw: &mut FaultInjector) -> FleetConfig {
    let envs = draw.number(1, 6) as u32;
    let tunes = draw.chance(0.3);
    let mut lanes = Vec::new();
    for &(driver, foreign) in drivers {
        let Driver::Lane(lane) = driver else { continue };
        let spec =
            LaneSpec { lane, policy: format!("p{lane}"), max_envs: envs, block_pages: 1, in_flight: 2 };
        let answer_timeout_s = draw.number(1, 3) as u32;
        let lane = Lane { spec, images: None, foreign, answer_timeout_s, execute: 1 };
        let spec = if foreign { PolicySpec::Attach("other".to_owned()) } else { PolicySpec::Idle };
        lanes.push(PolicyLane { spec, execution: Execution::chunk(1), checkpoint: None, lane });
    }
    FleetConfig {
        program: "fake".into(),
        base: "base".into(),
        shm: "shm".into(),
        run_id: seed,
        run: RUN.clone(),
        can_move: draw.chance(0.3),
        paired: draw.chance(0.2),
        earlier_renderer: draw.chance(0.3).then(|| RENDERER.to_owned()),
        capacity: Capacity { envs, max_envs: if tunes { 4 * envs } else { envs }, batch: envs, tunes },
        lanes,
        morphologies: vec![Morphology::Single],
        limits: Limits {
            sim_start: draw.millis(1_000, 3_000),
            host_start: draw.millis(2_000, 6_000),
            silence: draw.millis(500, 3_500),
            foreign: draw.millis(4_000, 12_000),
            shutdown: draw.millis(500, 1_500),
            failures: draw.number(2, 4) as u32,
            departures: draw.number(2, 5) as u32,
        },
    }
}
