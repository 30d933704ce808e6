//! `hypogeum replay --start`: actions executed from a given state.

use std::path::Path;

use anyhow::ensure;
use ipc_types::ImageSizes;
use serde::Serialize;
use sim::Profile;
use sim::demo::Recording;
use sim::physics::Parameters;
use sim::trajectory::{Replay, Start, Step, TrajectoryFile, read_actions};

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_out;
use crate::console::table::{Align, TextTable};
use crate::run::playback::ReplayedEpisode;

/// Result of a trajectory, as printed with `--json`.
#[derive(Serialize)]
struct ReplaySummary {
    task: &'static str,
    control_mode: &'static str,
    profile: Profile,
    /// Number of the first step after which the task had succeeded, from 1.
    first_success_step: Option<usize>,
    success_at_end: bool,
    /// State after each step.
    steps: Vec<Step>,
}

/// Executes the actions of one file from the start state of another and prints what happened.
pub(crate) fn print(start: &Path, actions: &Path, json: bool) -> Result<ExitStatus, Failure> {
    let (start, actions) = read(start, actions).or_user()?;
    let outcome = execute(&start, &actions).or_user()?;
    if json {
        print_out(&format!("{}\n", serde_json::to_string(&outcome).expect("finite numbers and strings")))?;
    } else {
        print_out(&summary(&start, &outcome))?;
    }
    Ok(ExitStatus::Success)
}

/// Records the same for a movie.
pub(crate) fn record(start: &Path, actions: &Path) -> anyhow::Result<ReplayedEpisode> {
    let (start, actions) = read(start, actions)?;
    let recording = Recording::from_start(&start, &actions)?;
    Ok(ReplayedEpisode { title: start.task.name().to_owned(), recording, images: ImageSizes::BENCHMARK })
}

fn read(start: &Path, actions: &Path) -> anyhow::Result<(Start, Vec<f32>)> {
    let start = Start::resolve(&TrajectoryFile::read(start)?, start)?;
    let actions = read_actions(actions, start.action_dim())?;
    Ok((start, actions))
}

fn execute(start: &Start, actions: &[f32]) -> anyhow::Result<ReplaySummary> {
    let mut replay = Replay::new(start, &Parameters::default());
    let mut steps = Vec::with_capacity(actions.len() / start.action_dim());
    for row in actions.chunks_exact(start.action_dim()) {
        replay.step(row);
        ensure!(replay.world().is_finite(), "the physics state is not finite after step {}", steps.len() + 1);
        steps.push(replay.record());
    }
    let succeeded = |step: &Step| step.unmet.is_none();
    Ok(ReplaySummary {
        task: start.task.name(),
        control_mode: start.mode.name(),
        profile: start.profile,
        first_success_step: steps.iter().position(succeeded).map(|idx| idx + 1),
        success_at_end: steps.last().is_some_and(succeeded),
        steps,
    })
}

/// Returns the outcome in words and a table of the bodies that can move.
fn summary(start: &Start, outcome: &ReplaySummary) -> String {
    use Align::{Left, Right};
    let ReplaySummary { task, control_mode, first_success_step, steps, .. } = outcome;
    let success =
        first_success_step.map_or("no success".to_owned(), |step| format!("success at step {step}"));
    let last = steps.last().expect("there is at least one action");
    let unmet = last.unmet.map_or(String::new(), |name| format!("; at the end not `{name}`"));
    let mut table = TextTable::new(&[
        ("body", Left),
        ("moved, mm", Right),
        ("x", Right),
        ("y", Right),
        ("z", Right),
        ("held by", Left),
    ]);
    for body in start.scene.bodies.iter().filter(|body| body.motion.can_move()) {
        let [x, y, z, ..] = last.bodies[body.name].pose;
        let from = body.pose.translation.vector;
        let moved = ((x - from.x).powi(2) + (y - from.y).powi(2) + (z - from.z).powi(2)).sqrt();
        let holders = last.arms.iter().enumerate().filter(|(_, arm)| arm.grasps.contains(&body.name));
        let holders: Vec<String> = holders.map(|(arm, _)| format!("arm {}", arm + 1)).collect();
        table.row(vec![
            body.name.to_owned(),
            format!("{:.1}", 1e3 * moved),
            format!("{x:.3}"),
            format!("{y:.3}"),
            format!("{z:.3}"),
            holders.join(", "),
        ]);
    }
    format!("{task}, {control_mode}: {} steps, {success}{unmet}\n{table}", steps.len())
}
