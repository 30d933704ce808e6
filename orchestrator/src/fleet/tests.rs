//! The fleet against children that obey a script: who is started again, what is run again, what is given up, what is left.

use std::collections::BTreeSet;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::{Duration, Instant};

use ipc_types::link::LaneSpec;

use super::*;
use crate::cli::parse_run;
use crate::plan::RunPlan;
use crate::work::jobs;

/// Far more than any of these runs needs.
const BOUND: Duration = Duration::from_secs(30);
const N_JOBS: usize = 12;

/// A folder with the fake program and its script.
struct Stage {
    folder: tempfile::TempDir,
    settings: Settings,
}

/// What came of a run.
struct Seen {
    result: Result<(Conclusion, Totals), FleetError>,
    /// Seeds of the episodes that were finished, in order.
    finished: Vec<u64>,
    log: Vec<String>,
}

impl Stage {
    /// A sim and, with a policy other than the expert, the host of policy `p`.
    fn new(script: &str, spec: &PolicySpec) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("fake");
        symlink(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/fleet/fake.sh"), &program).unwrap();
        std::fs::write(folder.path().join("script"), script).unwrap();
        let lane = LaneSpec { lane: 0, policy: "p".to_owned(), max_envs: 1, block_pages: 1, in_flight: 1 };
        let foreign = matches!(spec, PolicySpec::Attach(_));
        let policy = LanePolicy { spec: spec.clone(), lane: Lane { spec: lane, images: false, foreign } };
        let settings = Settings {
            program,
            base: folder.path().join("base"),
            shm: "/dev/shm".into(),
            run_id: std::hash::BuildHasher::hash_one(&std::hash::RandomState::new(), 0),
            config: parse_run("--envs 2 --threads 1").unwrap().config,
            drawn_with: None,
            lanes: if *spec == PolicySpec::Expert { Vec::new() } else { vec![policy] },
            morphologies: vec![Morphology::Single],
            limits: Limits {
                sim_start: BOUND,
                host_start: BOUND,
                silence: BOUND,
                leave: Duration::from_secs(2),
                deaths: 3,
            },
        };
        Self { folder, settings }
    }

    /// Runs a few episodes; `watch` sees the log and may stop the fleet.
    fn run(&self, mut watch: impl FnMut(&str, &Stopper)) -> Seen {
        let started = Instant::now();
        let policy = if self.settings.lanes.is_empty() { "expert" } else { "p=idle" };
        let arguments = format!("--policy {policy} --tasks RaiseCube --episodes {N_JOBS}");
        let jobs: Vec<Job> = jobs(&RunPlan::new(&parse_run(&arguments).unwrap()).unwrap()).collect();
        let fleet = Fleet::new(self.settings.clone());
        let stopper = fleet.stopper();
        let (mut finished, mut log) = (Vec::new(), Vec::new());
        let result = fleet.run(jobs, &mut |happening| {
            match happening {
                Happening::Finished(job, _) => finished.push(job.seed),
                Happening::Counters(_) | Happening::Drawing(_) => {}
                Happening::Log(line) => {
                    watch(line, &stopper);
                    log.push(line.to_owned());
                }
            }
            Ok(())
        });
        assert!(started.elapsed() < BOUND);
        assert_eq!(std::fs::read_dir(&self.settings.base).unwrap().count(), 0, "the domain is gone");
        Seen { result, finished, log }
    }

    fn births(&self, part: &str) -> usize {
        let births = std::fs::read_to_string(self.folder.path().join("births")).unwrap();
        births.lines().filter(|line| *line == part).count()
    }

    /// How often the sims were told something that begins so.
    fn heard(&self, command: &str) -> usize {
        let heard = std::fs::read_to_string(self.folder.path().join("heard")).unwrap();
        heard.lines().filter(|line| line.starts_with(command)).count()
    }
}

impl Seen {
    /// All episodes were finished, each once.
    fn is_whole(&self) -> bool {
        let distinct: BTreeSet<u64> = self.finished.iter().copied().collect();
        matches!(self.result, Ok((Conclusion::Complete, _)))
            && (self.finished.len(), distinct.len()) == (N_JOBS, N_JOBS)
    }

    fn error(&self) -> String {
        self.result.as_ref().unwrap_err().to_string()
    }
}

#[test]
fn children_work_leave_and_are_counted() {
    let stage = Stage::new("", &PolicySpec::Idle);
    let seen = stage.run(|_, _| ());
    assert!(seen.is_whole(), "{:?} {:?}", seen.result, seen.log);
    let (_, totals) = seen.result.unwrap();
    assert_eq!((totals.sim().env_steps, totals.restarts, totals.shm_bytes), (9 * N_JOBS as u64, 0, 5));
    assert_eq!((stage.births("sim"), stage.births("policy-host")), (1, 1));
}

#[test]
fn a_sim_that_is_killed_costs_only_its_unfinished_episodes() {
    let stage = Stage::new("sim 0 die 5\nsim 1 die 3", &PolicySpec::Idle);
    let seen = stage.run(|_, _| ());
    assert!(seen.is_whole(), "{:?} {:?}", seen.result, seen.log);
    assert_eq!((stage.births("sim"), stage.births("policy-host")), (3, 1));
    assert!(
        seen.log.iter().any(|line| line == "sim was killed by signal 9; starting it again"),
        "{:?}",
        seen.log
    );
    assert_eq!(seen.result.unwrap().1.restarts, 2);
}

#[test]
fn a_host_that_dies_is_replaced_and_the_sim_is_told() {
    let stage = Stage::new("sim * idle\npolicy-host 0 leave", &PolicySpec::Idle);
    let seen = stage.run(|line, stopper| {
        if line.contains("host of `p` exited with code 0; starting it again") {
            stopper.stop();
        }
    });
    assert_eq!(seen.result.unwrap().0, Conclusion::Stopped);
    assert_eq!((stage.births("sim"), stage.heard("{\"host_down\"")), (1, 1));
}

#[test]
fn a_child_that_always_dies_is_given_up() {
    let stage = Stage::new("policy-host * crash\nsim * idle", &PolicySpec::Idle);
    let seen = stage.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @r"
    host of `p` died 3 times without finishing an episode; at last it exited with code 7; the end of its log:
      crash
    ");
    assert!(!seen.result.unwrap_err().is_users());
    assert_eq!(stage.births("policy-host"), 3);

    let stage = Stage::new("sim * die 0", &PolicySpec::Expert);
    let seen = stage.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @r"
    sim died 3 times without finishing an episode; at last it was killed by signal 9; the end of its log:
      die 0
    ");
    assert_eq!((stage.births("sim"), seen.finished.len()), (3, 0));
}

#[test]
fn a_sim_that_hangs_is_killed_and_replaced() {
    let mut stage = Stage::new("sim 0 hang", &PolicySpec::Expert);
    stage.settings.limits.silence = Duration::from_millis(500);
    let seen = stage.run(|_, _| ());
    assert!(seen.is_whole(), "{:?} {:?}", seen.result, seen.log);
    assert_eq!(stage.births("sim"), 2);
}

#[test]
fn a_child_that_never_gets_ready_ends_the_run() {
    let mut stage = Stage::new("sim * mute", &PolicySpec::Expert);
    stage.settings.limits.sim_start = Duration::from_millis(500);
    let seen = stage.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @r"
    sim was not ready after 0 s; the end of its log:
      mute
    ");
}

#[test]
fn a_lane_that_fails_replaces_our_host_and_ends_the_run_for_a_foreign_one() {
    let stage = Stage::new("sim * fail", &PolicySpec::Idle);
    let seen = stage.run(|line, stopper| {
        if line.contains("host of `p` was killed by signal 9; starting it again") {
            stopper.stop();
        }
    });
    assert_eq!(seen.result.unwrap().0, Conclusion::Stopped);

    let stage = Stage::new("sim 0 fail", &PolicySpec::Attach("other".to_owned()));
    let seen = stage.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @"policy `p` has not answered");
    assert!(seen.result.unwrap_err().is_users());
    assert_eq!((stage.births("sim"), stage.heard("{\"host_up\"")), (1, 1));
}

#[test]
fn a_renderer_that_fails_or_changes_ends_the_run() {
    let blind = Stage::new("sim * blind", &PolicySpec::Expert);
    let seen = blind.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @"the sim failed to draw on x: it was lost; the same command continues where it stopped");
    assert!(seen.result.unwrap_err().is_users());
    assert_eq!(blind.births("sim"), 1);

    let fickle = Stage::new("sim 0 die 2\nsim 1 other", &PolicySpec::Expert);
    let seen = fickle.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @"finished episodes were drawn with none, but the sim now draws with other, whose images differ; choose the same with --renderer and --samples, or name another results file with --db");
    assert_eq!(fickle.births("sim"), 2);

    let mut resumed = Stage::new("", &PolicySpec::Expert);
    resumed.settings.drawn_with = Some("none with 4 samples per pixel".to_owned());
    let seen = resumed.run(|_, _| ());
    insta::assert_snapshot!(seen.error(), @"finished episodes were drawn with none with 4 samples per pixel, but the sim now draws with none, whose images differ; choose the same with --renderer and --samples, or name another results file with --db");
    assert!(seen.result.unwrap_err().is_users() && seen.finished.is_empty());
}

#[test]
fn a_foreign_host_is_invited() {
    let stage = Stage::new("", &PolicySpec::Attach("other".to_owned()));
    let mut invitation = String::new();
    let seen = stage.run(|line, _| {
        if let Some((_, path)) = line.split_once("its lane is in ") {
            invitation = std::fs::read_to_string(path).unwrap();
        }
    });
    assert!(seen.is_whole(), "{:?} {:?}", seen.result, seen.log);
    let invitation: serde_json::Value = serde_json::from_str(&invitation).unwrap();
    assert_eq!(invitation["lane"]["policy"], "p");
    assert_eq!(invitation["morphologies"][0], "single");
    assert_eq!(invitation["schema_hash"], format!("{:#018x}", ipc_types::SCHEMA_HASH));
}

#[test]
fn stopping_keeps_what_is_finished() {
    let stage = Stage::new("sim 0 die 4", &PolicySpec::Expert);
    let seen = stage.run(|line, stopper| {
        if line.starts_with("sim was killed") {
            stopper.stop();
        }
    });
    assert_eq!(seen.result.unwrap().0, Conclusion::Stopped);
    assert!((4..N_JOBS).contains(&seen.finished.len()));
}

#[test]
fn too_little_shared_memory_is_said_before_anything_is_started() {
    let mut stage = Stage::new("", &PolicySpec::Idle);
    stage.settings.lanes[0].lane.spec.max_envs = u32::MAX;
    stage.settings.lanes[0].lane.spec.block_pages = 1000;
    let seen = stage.run(|_, _| ());
    assert!(seen.error().contains("--envs"), "{}", seen.error());
    assert!(seen.result.unwrap_err().is_users());
    assert!(!stage.folder.path().join("births").exists());
}
