//! Appending of episodes that were executed elsewhere, such as in a Python process: their actions are
//! repeated here, and the frames rendered.

use std::collections::VecDeque;
use std::io::{self, BufRead, Write};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, sync_channel};

use anyhow::{Context, ensure};
use rayon::ThreadPoolBuilder;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use sim::TaskId;
use sim::demo::Recording;
use sim::episode::EpisodeSpec;
use sim::scene::stream::episode_seed;

use crate::selection::selectors::parse_task;
use crate::store::demos::dataset::{DatasetEpisode, DatasetSettings, DatasetWriter};
use crate::store::demos::rendering::{EPISODES_PER_THREAD, render};
use crate::store::stored_episode::format_fingerprint;

/// An executed episode, a line of the input.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExecutedEpisode {
    task: String,
    instruction: String,
    /// Index of the episode under the suite seed.
    episode: u32,
    /// Fingerprint of the trajectory, 16 hexadecimal digits.
    fingerprint: String,
    /// Action rows, `[n_steps, action_dim]`.
    actions: Vec<f32>,
}

/// Receives an episode from the thread that renders it.
type Rendering = Receiver<anyhow::Result<DatasetEpisode>>;

/// Appends episodes to the dataset in `folder` in the order of `lines`, until these end or one is empty. An
/// incomplete last line is ignored. Episodes before an error are kept.
///
/// First, writes to `answer` what the dataset has: `{"episodes": N, "next": {TASK: index after its last
/// episode}}`.
///
/// # Errors
/// If the dataset has other settings or cannot be written, or an episode cannot be repeated.
pub(crate) fn append(
    folder: &Path,
    settings: &DatasetSettings,
    mut lines: impl BufRead,
    mut answer: impl Write,
    n_threads: usize,
) -> anyhow::Result<()> {
    let pool = ThreadPoolBuilder::new().num_threads(n_threads).build().context("failed to start threads")?;
    let mut dataset = DatasetWriter::open(folder, settings.clone())?;
    let next =
        TaskId::ALL.iter().map(|task| (task.name().to_owned(), dataset.progress(task.name()).1.into()));
    let next: Map<String, Value> = next.collect();
    writeln!(answer, "{}", json!({"episodes": dataset.episodes().count(), "next": next}))?;
    answer.flush()?;
    let appended = pool.in_place_scope_fifo(|scope| {
        let mut rendering = VecDeque::new();
        while let Some(line) = next_line(&mut lines)? {
            let episode: ExecutedEpisode = serde_json::from_slice(&line).context("not an episode")?;
            if rendering.len() == EPISODES_PER_THREAD * n_threads {
                push_first(&mut rendering, &mut dataset)?;
            }
            let (send, receive) = sync_channel(1);
            // Nobody receives it if writing has failed.
            scope.spawn_fifo(move |_| drop(send.send(episode.repeat(settings))));
            rendering.push_back(receive);
        }
        while !rendering.is_empty() {
            push_first(&mut rendering, &mut dataset)?;
        }
        Ok(())
    });
    appended.and(dataset.close_file().and_then(|()| dataset.write_meta()))
}

/// Reads a line. Returns `None` at the end, which an empty line marks as well.
fn next_line(lines: &mut impl BufRead) -> io::Result<Option<Vec<u8>>> {
    let mut line = Vec::new();
    lines.read_until(b'\n', &mut line)?;
    Ok((line.ends_with(b"\n") && line != b"\n").then_some(line))
}

/// Waits for the first of the episodes and appends it.
fn push_first(rendering: &mut VecDeque<Rendering>, dataset: &mut DatasetWriter) -> anyhow::Result<()> {
    let Some(first) = rendering.pop_front() else { return Ok(()) };
    // A thread that panics sends nothing; the scope passes its panic on.
    first.recv().map_or(Ok(()), |episode| dataset.push(episode?))
}

impl ExecutedEpisode {
    /// Repeats the episode, checks that it is the same, and renders it.
    fn repeat(self, settings: &DatasetSettings) -> anyhow::Result<DatasetEpisode> {
        let &DatasetSettings { morphology, control_mode: mode, perturbation, strength, profile, .. } =
            settings;
        let Self { task: name, instruction, episode, fingerprint, actions } = self;
        let (task, width) = (parse_task(&name)?, mode.action_dim(morphology));
        ensure!(
            task.task().morphology == morphology
                && !actions.is_empty()
                && actions.len().is_multiple_of(width),
            "{name}: expected a task of the morphology {}, and rows of {width} numbers",
            morphology.name()
        );
        let seed = episode_seed(settings.seed, task.name(), episode);
        let spec = EpisodeSpec { task, perturbation, strength, profile };
        let recording = Recording::replay(spec, seed, mode, &actions)?;
        ensure!(
            format_fingerprint(recording.fingerprint()) == fingerprint,
            "{name}, episode {episode}: the program does not repeat it bit for bit; build it and the Python package \
             from the same sources"
        );
        let images = render(&recording, settings, &AtomicBool::new(false))?.unwrap_or_default();
        Ok(DatasetEpisode::new(task, instruction, episode, &recording, images))
    }
}
