//! Agreement of our physics with another simulator's: the same start states and actions, side by side.
//!
//! `cargo bench -p benches --bench agreement -- --trajectories DIR [--each yes] [--shifted N] [--csv FILE]`.
//! Every JSON file of the folder is a trajectory with a recorded motion (docs/trajectories.md;
//! `python/convert_recordings.py` converts recordings). Its actions are executed from its start, and
//! compared with what was recorded: success under either profile, at any time and at the end (of those that
//! were recorded to succeed at the end), the number of steps by which the first success comes later,
//! distances of the TCPs, of the arm joints and of the fingers over all steps, and of the bodies at the
//! end. Files are grouped by name, without the part after the last dot of the stem; `--each yes` lists
//! them one by one. `--shifted N` also executes every trajectory from N starts whose bodies are moved by
//! up to 0.3 mm: where single outcomes hang on fractions of a millimetre, the share of these that succeed
//! says more about the physics.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use benches::{Report, median};
use rayon::prelude::*;
use sim::Profile;
use sim::physics::Parameters;
use sim::scene::stream::Stream;
use sim::trajectory::{RecordedFile, Replay, Start, TrajectoryFile, read_actions};

/// Maximum shift of a body's start in each coordinate, in m.
const MAX_SHIFT_M: f64 = 3e-4;

fn main() -> Result<()> {
    let (mut folder, mut each, mut n_shifted) = (None, false, 0);
    let mut parameters = Parameters::default();
    let mut report = Report::with_options(
        "agreement",
        "--trajectories DIR, --set NAME=VALUE, --each yes, --shifted N, ",
        |flag, value| {
            match flag {
                "--trajectories" => folder = Some(PathBuf::from(value)),
                "--set" => parameters = with(&parameters, value)?,
                "--each" => each = value == "yes",
                "--shifted" => n_shifted = value.parse().context("--shifted needs a number")?,
                _ => return Ok(false),
            }
            Ok(true)
        },
    )?;
    let folder = folder.context("--trajectories DIR is required")?;
    let mut files = Vec::new();
    for entry in std::fs::read_dir(&folder).with_context(|| format!("read {}", folder.display()))? {
        files.push(entry?.path());
    }
    files.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    files.sort();
    ensure!(!files.is_empty(), "{} has no trajectories", folder.display());
    let compared: Vec<ReplayDeviation> = files
        .par_iter()
        .map(|path| ReplayDeviation::of(path, &parameters, n_shifted))
        .collect::<Result<_>>()?;

    let mut groups: BTreeMap<&str, Vec<&ReplayDeviation>> = BTreeMap::new();
    for comparison in &compared {
        let name = &comparison.name;
        let group = if each { name } else { name.rsplit_once('.').map_or(&**name, |(group, _)| group) };
        groups.entry(group).or_default().push(comparison);
    }
    println!(
        "{:36} {:>7} {:>7} {:>7} {:>7} {:>8} {:>8} {:>9} {:>15} {:>15} {:>15} {:>17}",
        "",
        "strict",
        "at end",
        "paper",
        "at end",
        "shifted",
        "at end",
        "steps",
        "TCP mm",
        "joints mrad",
        "fingers mm",
        "bodies at end mm"
    );
    for (group, members) in &groups {
        print_row(group, members, n_shifted);
        for (figure, value, unit) in figures(members) {
            report.add(&format!("{group}/{figure}"), value, unit, "");
        }
    }
    print_row("all", &compared.iter().collect::<Vec<_>>(), n_shifted);
    report.finish()
}

/// Returns the parameters with one of them changed, by `NAME=VALUE` in JSON.
fn with(parameters: &Parameters, assignment: &str) -> Result<Parameters> {
    let (name, value) = assignment.split_once('=').context("--set needs NAME=VALUE")?;
    let mut fields = serde_json::to_value(parameters)?;
    fields[name] = serde_json::from_str(value).with_context(|| format!("{value} is not a number"))?;
    serde_json::from_value(fields).with_context(|| format!("cannot set {name}"))
}

/// Our motion against the recorded one.
struct ReplayDeviation {
    name: String,
    /// Success of ours under each profile, and as recorded.
    ours: [ReplayOutcome; 2],
    recorded: ReplayOutcome,
    /// Distances after each step and arm (or after each step, arm and joint), in m or rad.
    tcp: Vec<f64>,
    joints: Vec<f64>,
    fingers: Vec<f64>,
    /// Distance of each movable body at the end, in m.
    bodies: Vec<f64>,
    /// Successes from shifted starts.
    shifted: Vec<ReplayOutcome>,
}

/// Success of one motion.
#[derive(Clone, Copy, Default)]
struct ReplayOutcome {
    first_success_step: Option<u32>,
    at_end: bool,
}

impl ReplayOutcome {
    fn add(&mut self, step: u32, succeeds: bool) {
        self.at_end = succeeds;
        if succeeds {
            self.first_success_step.get_or_insert(step);
        }
    }
}

impl ReplayDeviation {
    fn of(path: &Path, parameters: &Parameters, n_shifted: u64) -> Result<Self> {
        let name = path.file_stem().and_then(|stem| stem.to_str()).context("a file name is not UTF-8")?;
        let mut file = TrajectoryFile::read(path)?;
        let recorded = file.recorded.take();
        let recorded = recorded.with_context(|| format!("{} has no recorded motion", path.display()))?;
        let [strict, paper] = [Profile::Strict, Profile::Paper].map(|profile| {
            file.profile = profile;
            Start::resolve(&file, path)
        });
        let (strict, paper) = (strict?, paper?);
        let actions = read_actions(path, strict.action_dim())?;
        let n_steps = actions.len() / strict.action_dim();
        ensure!(
            recorded.tcp.len() == n_steps && recorded.qpos.len() == n_steps,
            "{}: {n_steps} actions, but {} recorded steps",
            path.display(),
            recorded.qpos.len()
        );
        let mut result = Self {
            name: name.to_owned(),
            ours: [ReplayOutcome::default(), outcome(&paper, &actions, parameters)],
            recorded: ReplayOutcome {
                first_success_step: recorded.first_success_step,
                at_end: recorded.success_at_end.unwrap_or(true),
            },
            tcp: Vec::new(),
            joints: Vec::new(),
            fingers: Vec::new(),
            bodies: Vec::new(),
            shifted: Vec::new(),
        };
        result.step_through(&strict, &actions, &recorded, parameters);
        file.profile = Profile::Strict;
        for idx in 0..n_shifted {
            let start = Start::resolve(&shifted(&file, &result.name, idx), path)?;
            result.shifted.push(outcome(&start, &actions, parameters));
        }
        Ok(result)
    }

    fn step_through(
        &mut self,
        start: &Start,
        actions: &[f32],
        recorded: &RecordedFile,
        parameters: &Parameters,
    ) {
        let mut replay = Replay::new(start, parameters);
        for (i, row) in actions.chunks_exact(start.action_dim()).enumerate() {
            replay.step(row);
            self.ours[0].add(i as u32 + 1, replay.unmet().is_none());
            let world = replay.world();
            for (arm, (tcp, qpos)) in recorded.tcp[i].iter().zip(&recorded.qpos[i]).enumerate() {
                let position = world.tcp_pose(arm).translation.vector.cast::<f64>();
                self.tcp.push((position - nalgebra::Vector3::from(*tcp)).norm());
                let difference = |dof: usize| (f64::from(world.qpos(arm)[dof]) - qpos[dof]).abs();
                self.joints.extend((0..7).map(difference));
                self.fingers.extend((7..9).map(difference));
            }
        }
        for (idx, body) in start.scene.bodies.iter().enumerate() {
            if let Some([x, y, z, ..]) = recorded.bodies_at_end.get(body.name)
                && body.motion.can_move()
            {
                let position = replay.world().body_pose(idx).translation.vector.cast::<f64>();
                self.bodies.push((position - nalgebra::Vector3::new(*x, *y, *z)).norm());
            }
        }
    }
}

/// Returns the trajectory with every body moved by up to `MAX_SHIFT_M` in x and y.
fn shifted(file: &TrajectoryFile, name: &str, idx: u64) -> TrajectoryFile {
    let (mut file, mut stream) = (file.clone(), Stream::new(idx, name));
    for body in file.bodies.values_mut() {
        for coordinate in &mut body.pose[..2] {
            *coordinate += MAX_SHIFT_M * (2.0 * stream.unit() - 1.0);
        }
    }
    file
}

fn outcome(start: &Start, actions: &[f32], parameters: &Parameters) -> ReplayOutcome {
    let mut replay = Replay::new(start, parameters);
    let mut outcome = ReplayOutcome::default();
    for (step, row) in (1..).zip(actions.chunks_exact(start.action_dim())) {
        replay.step(row);
        outcome.add(step, replay.unmet().is_none());
    }
    outcome
}

/// Returns the figures of a group of trajectories: name, value, unit.
fn figures(members: &[&ReplayDeviation]) -> Vec<(&'static str, f64, &'static str)> {
    let once: fn(&ReplayOutcome) -> bool = |outcome| outcome.first_success_step.is_some();
    let end_in_success = || members.iter().filter(|it| it.recorded.at_end);
    let successes = |profile: usize| members.iter().filter(|it| once(&it.ours[profile])).count() as f64;
    let at_end = |profile: usize| end_in_success().filter(|it| it.ours[profile].at_end).count() as f64;
    let all = |values: fn(&ReplayDeviation) -> &[f64]| -> Vec<f64> {
        members.iter().flat_map(|it| values(it).iter().map(|value| 1e3 * value)).collect()
    };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let max = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let (tcp, joints, fingers) = (all(|it| &it.tcp), all(|it| &it.joints), all(|it| &it.fingers));
    let shifted = members.iter().flat_map(|it| &it.shifted).filter(|it| once(it)).count() as f64;
    let shifted_at_end = end_in_success().flat_map(|it| &it.shifted).filter(|it| it.at_end).count() as f64;
    let mut result = vec![
        ("n", members.len() as f64, "trajectories"),
        ("n_at_end", end_in_success().count() as f64, "trajectories"),
        ("success_strict", successes(0), "trajectories"),
        ("success_strict_at_end", at_end(0), "trajectories"),
        ("success_paper", successes(1), "trajectories"),
        ("success_paper_at_end", at_end(1), "trajectories"),
        ("success_shifted", shifted, "trajectories"),
        ("success_shifted_at_end", shifted_at_end, "trajectories"),
        ("tcp_mean", mean(&tcp), "mm"),
        ("tcp_max", max(&tcp), "mm"),
        ("joints_mean", mean(&joints), "mrad"),
        ("joints_max", max(&joints), "mrad"),
        ("fingers_mean", mean(&fingers), "mm"),
        ("fingers_max", max(&fingers), "mm"),
    ];
    let mut bodies = all(|it| &it.bodies);
    if !bodies.is_empty() {
        result.push(("bodies_median", median(&mut bodies), "mm"));
        result.push(("bodies_max", max(&bodies), "mm"));
    }
    result
}

fn print_row(name: &str, members: &[&ReplayDeviation], n_shifted: u64) {
    let figures: BTreeMap<&str, f64> = figures(members).into_iter().map(|it| (it.0, it.1)).collect();
    let later = members.iter().filter_map(|it| {
        Some(i64::from(it.ours[0].first_success_step?) - i64::from(it.recorded.first_success_step?))
    });
    let later: Vec<i64> = later.collect();
    let steps = match (later.iter().min(), later.iter().max()) {
        (Some(min), Some(max)) if min == max => format!("{min:+}"),
        (Some(min), Some(max)) => format!("{min:+}..{max:+}"),
        _ => "–".to_owned(),
    };
    let pair = |figure: &str, digits: usize| {
        let of = |kind: &str| figures.get(&*format!("{figure}_{kind}")).copied();
        let first = of("mean").or_else(|| of("median"));
        first.zip(of("max")).map_or("–".to_owned(), |(a, b)| format!("{a:.digits$} / {b:.digits$}"))
    };
    let count = |figure: &str, of: f64| match of {
        0.0 => "–".to_owned(),
        _ => format!("{}/{of}", figures[figure]),
    };
    let n = figures["n"];
    let n_shifted = n_shifted as f64;
    println!(
        "{name:36} {:>7} {:>7} {:>7} {:>7} {:>8} {:>8} {steps:>9} {:>15} {:>15} {:>15} {:>17}",
        count("success_strict", n),
        count("success_strict_at_end", figures["n_at_end"]),
        count("success_paper", n),
        count("success_paper_at_end", figures["n_at_end"]),
        count("success_shifted", n * n_shifted),
        count("success_shifted_at_end", figures["n_at_end"] * n_shifted),
        pair("tcp", 2),
        pair("joints", 2),
        pair("fingers", 2),
        pair("bodies", 1),
    );
}
