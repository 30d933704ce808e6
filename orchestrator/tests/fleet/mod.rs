//! The fleet with fake children that follow a script: restarts, re-run episodes, failures and cleanup.

use std::collections::BTreeSet;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::{Duration, Instant};

use ipc_types::Morphology;
use ipc_types::link::{LaneSpec, SHM};
use policy_host::PolicySpec;
use run_config::Execution;
use sim::serve::protocol::{Lane, Outcome};

use super::*;
use crate::fleet::processes::member::Member;
use crate::plan::RunPlan;
use crate::plan::capacity::Capacity;
use crate::plan::lanes::PolicyLane;
use crate::plan::sweep::SweepArgs;
use crate::store::results::FinishedEpisodes;

/// A time limit far above the duration of these runs.
const BOUND: Duration = Duration::from_secs(30);
const N_JOBS: usize = 12;

/// A folder with the fake program and its script, and a configuration that uses it.
struct TestFleet {
    folder: tempfile::TempDir,
    config: FleetConfig,
}

/// The outcome of a run.
struct RunRecord {
    result: Result<(RunStatus, Totals), FleetError>,
    /// Seeds of the finished episodes, in order.
    finished: Vec<u64>,
    /// Errors of the other recorded episodes.
    errors: Vec<String>,
    log: Vec<String>,
}

impl TestFleet {
    /// Makes a fleet of a sim and, unless the policy is the expert, a host of policy `p`.
    fn new(script: &str, spec: &PolicySpec) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("fake");
        symlink(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fleet/fake.sh"), &program).unwrap();
        std::fs::write(folder.path().join("script"), script).unwrap();
        let lane = LaneSpec { lane: 0, policy: "p".to_owned(), max_envs: 1, block_pages: 1, in_flight: 1 };
        let foreign = matches!(spec, PolicySpec::Attach(_));
        let policy = PolicyLane {
            spec: spec.clone(),
            execution: Execution::chunk(1),
            checkpoint: None,
            lane: Lane {
                spec: lane,
                images: None,
                foreign,
                answer_timeout_s: Lane::ANSWER_TIMEOUT_S,
                execute: 1,
            },
        };
        let config = FleetConfig {
            program,
            base: folder.path().join("base"),
            shm: SHM.into(),
            run_id: std::hash::BuildHasher::hash_one(&std::hash::RandomState::new(), 0),
            run: SweepArgs::parse("--threads 1").unwrap().config,
            earlier_renderer: None,
            can_move: false,
            paired: false,
            capacity: Capacity { envs: 2, max_envs: 2, batch: 1, tunes: false },
            lanes: if *spec == PolicySpec::Expert { Vec::new() } else { vec![policy] },
            morphologies: vec![Morphology::Single],
            limits: Limits {
                sim_start: BOUND,
                host_start: BOUND,
                silence: BOUND,
                foreign: BOUND,
                shutdown: Duration::from_secs(2),
                failures: 3,
                departures: 10,
            },
        };
        Self { folder, config }
    }

    /// Runs a few episodes. `watch` receives the log lines and may stop the fleet.
    fn run(&self, watch: impl FnMut(&str, &Stopper)) -> RunRecord {
        let policy = if self.config.lanes.is_empty() { "expert" } else { "p=idle" };
        self.run_policies(policy, watch)
    }

    /// Runs a few episodes of each of these policies.
    fn run_policies(&self, policies: &str, mut watch: impl FnMut(&str, &Stopper)) -> RunRecord {
        let started = Instant::now();
        let arguments = format!("--policy {policies} --tasks RaiseCube --episodes {N_JOBS}");
        let plan = RunPlan::new(&SweepArgs::parse(&arguments).unwrap()).unwrap();
        let jobs = JobList::unfinished(&plan, FinishedEpisodes::default(), None);
        let fleet = Fleet::new(self.config.clone());
        let stopper = fleet.stopper();
        let (mut finished, mut errors, mut log) = (Vec::new(), Vec::new(), Vec::new());
        let result = fleet.run(&jobs, &mut |event: &FleetEvent<'_>| {
            match event {
                FleetEvent::EpisodeFinished(_, Outcome { error: Some(error), .. }) => {
                    errors.push(error.clone());
                }
                FleetEvent::EpisodeFinished(job, _) => finished.push(job.seed),
                FleetEvent::Counters(_) | FleetEvent::RendererReady(_) | FleetEvent::Spans(..) => {}
                FleetEvent::Log(line) => {
                    watch(line, &stopper);
                    log.push((*line).to_owned());
                }
            }
            Ok(())
        });
        assert!(started.elapsed() < BOUND);
        assert_eq!(std::fs::read_dir(&self.config.base).unwrap().count(), 0, "the domain is removed");
        RunRecord { result, finished, errors, log }
    }

    /// Returns how often a child was spawned.
    fn spawns(&self, part: &str) -> usize {
        let spawns = std::fs::read_to_string(self.folder.path().join("spawns")).unwrap();
        spawns.lines().filter(|line| *line == part).count()
    }

    /// Returns the number of commands to sims that start with `command`.
    fn received(&self, command: &str) -> usize {
        let received = std::fs::read_to_string(self.folder.path().join("received")).unwrap();
        received.lines().filter(|line| line.starts_with(command)).count()
    }
}

impl RunRecord {
    /// Returns `true` if all episodes were finished, each once.
    fn is_complete(&self) -> bool {
        let distinct: BTreeSet<u64> = self.finished.iter().copied().collect();
        matches!(self.result, Ok((RunStatus::Complete, _)))
            && (self.finished.len(), distinct.len()) == (N_JOBS, N_JOBS)
    }

    fn error(&self) -> String {
        let error = self.result.as_ref().unwrap_err();
        std::iter::successors(Some(error as &dyn std::error::Error), |error| error.source())
            .map(ToString::to_string)
            .collect::<Vec<_>>()
            .join(": ")
    }
}

#[test]
fn run_completes_and_counts_work() {
    let fleet = TestFleet::new("", &PolicySpec::Idle);
    let run = fleet.run(|_, _| ());
    assert!(run.is_complete(), "{:?} {:?}", run.result, run.log);
    let (_, totals) = run.result.unwrap();
    assert_eq!((totals.sim().env_steps, totals.restarts, totals.shm_bytes), (9 * N_JOBS as u64, 0, 5));
    assert_eq!((fleet.spawns("sim"), fleet.spawns("policy-host")), (1, 1));
}

#[test]
fn killed_sim_repeats_only_unfinished_episodes() {
    let fleet = TestFleet::new("sim 0 die 5\nsim 1 die 3", &PolicySpec::Idle);
    let run = fleet.run(|_, _| ());
    assert!(run.is_complete(), "{:?} {:?}", run.result, run.log);
    assert_eq!((fleet.spawns("sim"), fleet.spawns("policy-host")), (3, 1));
    assert!(run.log.iter().any(|line| line == "sim was killed by signal 9; restarting it"), "{:?}", run.log);
    assert_eq!(run.result.unwrap().1.restarts, 2);
}

#[test]
fn exited_host_is_restarted_and_announced() {
    let fleet = TestFleet::new("sim * idle\npolicy-host 0 leave", &PolicySpec::Idle);
    let run = fleet.run(|line, stopper| {
        if line.contains("host of `p` exited with code 0; restarting it") {
            stopper.stop();
        }
    });
    assert_eq!(run.result.unwrap().0, RunStatus::Stopped);
    assert_eq!((fleet.spawns("sim"), fleet.received("{\"host_down\"")), (1, 1));
}

#[test]
fn run_ends_when_child_keeps_failing() {
    let fleet = TestFleet::new("policy-host * crash\nsim * idle", &PolicySpec::Idle);
    let run = fleet.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"host of `p` failed 3 times without finishing an episode; the last time it exited with code 7; the end of its log: crash");
    assert!(!run.result.unwrap_err().is_user_error());
    assert_eq!(fleet.spawns("policy-host"), 3);

    let fleet = TestFleet::new("sim * die 0", &PolicySpec::Expert);
    let run = fleet.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"sim was ended 3 times from outside; the last time it was killed by signal 9: find out who sends that signal");
    assert_eq!((fleet.spawns("sim"), run.finished.len()), (3, 0));
}

#[test]
fn hung_sim_is_killed_and_restarted() {
    let mut fleet = TestFleet::new("sim 0 hang", &PolicySpec::Expert);
    fleet.config.limits.silence = Duration::from_millis(500);
    let run = fleet.run(|_, _| ());
    assert!(run.is_complete(), "{:?} {:?}", run.result, run.log);
    assert_eq!(fleet.spawns("sim"), 2);
}

#[test]
fn run_ends_when_child_never_gets_ready() {
    let mut fleet = TestFleet::new("sim * mute", &PolicySpec::Expert);
    fleet.config.limits.sim_start = Duration::from_millis(500);
    let run = fleet.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"sim failed 3 times without finishing an episode; the last time it was killed by signal 9; the end of its log: mute | sim was not ready after 0 s; killed it");
}

#[test]
fn failed_lane_restarts_own_host_only() {
    let fleet = TestFleet::new("sim * fail", &PolicySpec::Idle);
    let run = fleet.run(|line, stopper| {
        if line.contains("host of `p` was killed by signal 9; restarting it") {
            stopper.stop();
        }
    });
    assert_eq!(run.result.unwrap().0, RunStatus::Stopped);

    let fleet = TestFleet::new("sim 0 fail", &PolicySpec::Attach("other".to_owned()));
    let run = fleet.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"policy `p` has not answered");
    assert!(run.result.unwrap_err().is_user_error());
    assert_eq!((fleet.spawns("sim"), fleet.received("{\"host_up\"")), (1, 1));
    assert_eq!(run.log.iter().filter(|line| line.ends_with("has not answered; trying again")).count(), 2);
}

#[test]
fn given_up_policy_costs_only_its_episodes() {
    let failing = [
        ("policy-host * crash\nsim * expert", PolicySpec::Idle, "its host exits"),
        ("sim * fail", PolicySpec::Attach("other".to_owned()), "its foreign host does not answer"),
        ("sim * desert", PolicySpec::Attach("other".to_owned()), "its foreign hosts leave"),
    ];
    for (script, spec, what) in failing {
        let fleet = TestFleet::new(script, &spec);
        let run = fleet.run_policies("p=idle --policy expert", |_, _| ());
        assert_eq!(run.result.unwrap().0, RunStatus::Complete, "{what}: {:?}", run.log);
        assert_eq!((run.finished.len(), run.errors.len()), (N_JOBS, N_JOBS), "{what}: {:?}", run.log);
        assert!(run.errors.iter().all(|error| error.starts_with("the policy was given up: ")), "{what}");
        assert!(run.log.iter().any(|line| line.contains("gave up policy `p`")), "{what}: {:?}", run.log);
        assert_eq!(fleet.received("{\"give_up\""), 1, "{what}");
    }
}

/// The sim ignores its first two commands for episodes, as if they had been lost.
#[test]
fn lost_commands_are_sent_again() {
    let fleet = TestFleet::new("sim 0 deaf", &PolicySpec::Expert);
    let run = fleet.run(|_, _| ());
    assert!(run.is_complete(), "{:?} {:?}", run.result, run.log);
    assert_eq!((fleet.spawns("sim"), fleet.received("{\"run\"")), (1, N_JOBS + 2));
}

#[test]
fn taken_attach_name_is_refused() {
    let first = TestFleet::new("sim * idle", &PolicySpec::Attach("other".to_owned()));
    let mut second = TestFleet::new("", &PolicySpec::Attach("other".to_owned()));
    second.config.base.clone_from(&first.config.base);
    let mut refused = None;
    let run = first.run(|line, stopper| {
        if line.contains("its lane is in") {
            let fleet = Fleet::new(second.config.clone());
            let error = fleet.run(&JobList::of(Vec::new()), &mut |_: &FleetEvent<'_>| Ok(())).unwrap_err();
            refused = Some((error.is_user_error(), error.to_string()));
            stopper.stop();
        }
    });
    assert_eq!(run.result.unwrap().0, RunStatus::Stopped);
    let (is_user_error, message) = refused.unwrap();
    assert!(is_user_error && message.contains("another run already waits for a foreign host named `other`"));
}

#[test]
fn failures_count_within_a_window_only() {
    let (mut member, window) = (Member::default(), Duration::from_secs(100));
    let mut add = |seconds| member.add_failure(Duration::from_secs(seconds), window);
    assert_eq!([add(0), add(60), add(120), add(130), add(1000)], [1, 2, 2, 3, 1]);
}

#[test]
fn run_ends_when_renderer_fails_or_changes() {
    let blind = TestFleet::new("sim * blind", &PolicySpec::Expert);
    let run = blind.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"the sim failed to draw on x: it was lost; run the same command to resume");
    assert!(run.result.unwrap_err().is_user_error());
    assert_eq!(blind.spawns("sim"), 1);

    let fickle = TestFleet::new("sim 0 die 2\nsim 1 other", &PolicySpec::Expert);
    let run = fickle.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"finished episodes were rendered with none, but the sim now renders with other, whose images differ; choose the same with --renderer and --samples, or use another results file with --db");
    assert_eq!(fickle.spawns("sim"), 2);

    let mut resumed = TestFleet::new("", &PolicySpec::Expert);
    resumed.config.earlier_renderer = Some("none with 4 samples per pixel".to_owned());
    let run = resumed.run(|_, _| ());
    insta::assert_snapshot!(run.error(), @"finished episodes were rendered with none with 4 samples per pixel, but the sim now renders with none, whose images differ; choose the same with --renderer and --samples, or use another results file with --db");
    assert!(run.result.unwrap_err().is_user_error() && run.finished.is_empty());
}

#[test]
fn foreign_host_gets_lane_description() {
    let fleet = TestFleet::new("", &PolicySpec::Attach("other".to_owned()));
    let mut description = String::new();
    let run = fleet.run(|line, _| {
        if let Some((_, path)) = line.split_once("its lane is in ") {
            description = std::fs::read_to_string(path).unwrap();
        }
    });
    assert!(run.is_complete(), "{:?} {:?}", run.result, run.log);
    let description: serde_json::Value = serde_json::from_str(&description).unwrap();
    assert_eq!(description["lane"]["policy"], "p");
    assert_eq!(description["morphologies"][0], "single");
    assert_eq!(description["schema_hash"], format!("{:#018x}", ipc_types::SCHEMA_HASH));
}

#[test]
fn stop_keeps_finished_episodes() {
    let fleet = TestFleet::new("sim 0 die 4", &PolicySpec::Expert);
    let run = fleet.run(|line, stopper| {
        if line.starts_with("sim was killed") {
            stopper.stop();
        }
    });
    assert_eq!(run.result.unwrap().0, RunStatus::Stopped);
    assert!((4..N_JOBS).contains(&run.finished.len()));
}

#[test]
fn shared_memory_is_checked_before_spawning() {
    let mut fleet = TestFleet::new("", &PolicySpec::Idle);
    fleet.config.lanes[0].lane.spec.max_envs = u32::MAX;
    fleet.config.lanes[0].lane.spec.block_pages = 1000;
    let run = fleet.run(|_, _| ());
    assert!(run.error().contains("--envs"), "{}", run.error());
    assert!(run.result.unwrap_err().is_user_error());
    assert!(!fleet.folder.path().join("spawns").exists());
}
