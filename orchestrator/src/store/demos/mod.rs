//! Recording of demonstrations: successful episodes of the experts, as datasets that LeRobot can train on.

mod append;
mod dataset;
mod image;
mod rendering;

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Instant;

use anyhow::Context;
use ipc_types::Morphology;
use rayon::{ScopeFifo, ThreadPoolBuilder};
use sim::TaskId;
use sim::demo::{DemoError, Recording};
use sim::episode::EpisodeSpec;
use sim::perturb::Language;
use sim::scene::stream::episode_seed;

use self::dataset::{DatasetEpisode, DatasetWriter, EpisodeRecord};
use self::rendering::{EPISODES_PER_THREAD, render};

pub(crate) use self::append::append;
pub(crate) use self::dataset::{DatasetSettings, StoredDataset};
pub(crate) use self::image::ImageFormat;
use crate::console::exit::ExitStatus;
use crate::console::output::{print_message, print_out};
use crate::console::progress::Progress;
use crate::console::table::{Align, TextTable};

/// A task is given up after this many tries per requested demonstration plus [`EXTRA_TRIES`].
const MAX_TRIES_PER_DEMO: u32 = 10;
const EXTRA_TRIES: u32 = 20;

/// The demonstrations to record.
pub(crate) struct DemoPlan {
    pub(crate) tasks: Vec<TaskId>,
    /// Demonstrations per task.
    pub(crate) episodes: u32,
    /// Settings of single-arm episodes. Bimanual ones differ in morphology and control mode.
    pub(crate) single_arm: DatasetSettings,
    /// Sentences of the tasks.
    pub(crate) language: Language,
    pub(crate) n_threads: usize,
}

/// The episodes of one task that are being recorded.
struct TaskQueue {
    task: TaskId,
    dataset_idx: usize,
    /// Demonstrations in the dataset.
    n_done: u32,
    /// Index of the next episode to start.
    next: u32,
    /// Episodes in the order of their indices; those without success are `None`.
    recording: VecDeque<Receiver<anyhow::Result<Option<DatasetEpisode>>>>,
}

/// The demonstrations of one task.
struct TaskYield {
    task: TaskId,
    demonstrations: u32,
    tries: u32,
    frames: u64,
}

impl DemoPlan {
    fn settings_of(&self, morphology: Morphology) -> DatasetSettings {
        let control_mode = morphology.control_mode(self.single_arm.control_mode);
        DatasetSettings { morphology, control_mode, ..self.single_arm.clone() }
    }

    /// Records until each task has enough demonstrations, is given up, or `stopped` is set.
    ///
    /// # Errors
    /// If a dataset cannot be opened or written.
    pub(crate) fn run(&self, folder: &Path, quiet: bool, stopped: &AtomicBool) -> anyhow::Result<ExitStatus> {
        let pool = ThreadPoolBuilder::new().num_threads(self.n_threads).build();
        let pool = pool.context("failed to start threads")?;
        let started = Instant::now();
        let (mut datasets, mut queues) = (Vec::new(), Vec::new());
        for morphology in Morphology::ALL {
            let own = self.tasks.iter().copied().filter(|task| task.task().morphology == morphology);
            let mut own = own.peekable();
            if own.peek().is_some() {
                let dataset =
                    DatasetWriter::open(&folder.join(morphology.name()), self.settings_of(morphology))?;
                queues.extend(own.map(|task| TaskQueue::new(task, &dataset, datasets.len())));
                datasets.push(dataset);
            }
        }
        let done: u32 = queues.iter().map(|queue| queue.n_done.min(self.episodes)).sum();
        let n = u64::from(self.episodes) * self.tasks.len() as u64;
        let n_frames = |datasets: &[DatasetWriter]| datasets.iter().map(DatasetWriter::n_frames).sum::<u64>();
        let frames_before = n_frames(&datasets);
        let mut progress = Progress::of_demonstrations(n, u64::from(done), quiet);
        pool.in_place_scope_fifo(|scope| {
            self.record(scope, &mut datasets, &mut queues, &mut progress, stopped)
                .inspect_err(|_| stopped.store(true, Ordering::Relaxed))
        })?;
        datasets.iter_mut().try_for_each(DatasetWriter::write_meta)?;
        progress.finish();
        let yields: Vec<TaskYield> =
            queues.iter().map(|queue| TaskYield::new(queue.task, &datasets[queue.dataset_idx])).collect();
        let frames = n_frames(&datasets);
        let seconds = started.elapsed().as_secs_f64();
        print_out(&table(&yields))?;
        print_message(&format!(
            "{}: {frames} frames, {:.1} new ones per second for {seconds:.0} s",
            folder.display(),
            (frames - frames_before) as f64 / seconds
        ));
        if stopped.load(Ordering::Relaxed) {
            print_message("interrupted; run the same command to resume");
            return Ok(ExitStatus::Interrupted);
        }
        let short = yields.iter().any(|own| own.demonstrations < self.episodes);
        Ok(if short { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
    }

    /// Records the missing episodes of all tasks on the scope's threads and writes them in the order of
    /// tasks and indices, whatever the number of threads. Episodes of later tasks are recorded meanwhile.
    fn record<'scope>(
        &'scope self,
        scope: &ScopeFifo<'scope>,
        datasets: &mut [DatasetWriter],
        queues: &mut [TaskQueue],
        progress: &mut Progress,
        stopped: &'scope AtomicBool,
    ) -> anyhow::Result<()> {
        for current in 0..queues.len() {
            loop {
                self.refill(scope, &mut queues[current..], stopped);
                let queue = &mut queues[current];
                let Some(recorded) = queue.recording.pop_front() else { break };
                // A thread that panics sends nothing; the scope passes its panic on.
                let Ok(recorded) = recorded.recv() else { return Ok(()) };
                if stopped.load(Ordering::Relaxed) {
                    return Ok(());
                }
                if let Some(episode) = recorded? {
                    datasets[queue.dataset_idx].push(episode)?;
                    queue.n_done += 1;
                    progress.tick();
                }
            }
            let TaskQueue { task, n_done, next, dataset_idx, .. } = queues[current];
            if n_done < self.episodes {
                let (name, wanted) = (task.name(), self.episodes);
                progress.log(&format!(
                    "{name}: {n_done} of {wanted} demonstrations after {next} tries; giving up"
                ));
            }
            datasets[dataset_idx].close_file()?;
        }
        Ok(())
    }

    /// Starts episodes until enough are being recorded or wait to be written.
    fn refill<'scope>(
        &'scope self,
        scope: &ScopeFifo<'scope>,
        queues: &mut [TaskQueue],
        stopped: &'scope AtomicBool,
    ) {
        let max_tries = self.episodes.saturating_mul(MAX_TRIES_PER_DEMO).saturating_add(EXTRA_TRIES);
        let mut free = (EPISODES_PER_THREAD * self.n_threads)
            .saturating_sub(queues.iter().map(|queue| queue.recording.len()).sum());
        for queue in queues {
            while free > 0
                && queue.n_done + (queue.recording.len() as u32) < self.episodes
                && queue.next < max_tries
            {
                let (send, receive) = sync_channel(1);
                let (task, index) = (queue.task, queue.next);
                // Nobody receives it if writing has failed.
                scope.spawn_fifo(move |_| drop(send.send(self.episode(task, index, stopped))));
                queue.recording.push_back(receive);
                queue.next += 1;
                free -= 1;
            }
        }
    }

    /// Records and renders the expert's episode of this index. Returns `None` if it does not succeed.
    fn episode(
        &self,
        task: TaskId,
        index: u32,
        stopped: &AtomicBool,
    ) -> anyhow::Result<Option<DatasetEpisode>> {
        let settings = self.settings_of(task.task().morphology);
        let DatasetSettings { perturbation, strength, profile, .. } = settings;
        let subject = EpisodeSpec { task, perturbation, strength, profile };
        let seed = episode_seed(settings.seed, task.name(), index);
        let recording = match Recording::of_expert(subject, seed, settings.control_mode) {
            Ok(recording) if recording.success_at_end() => recording,
            Ok(_) | Err(DemoError::Plan(_) | DemoError::Diverged(_)) => return Ok(None),
            Err(error @ DemoError::Mode { .. }) => return Err(error.into()),
        };
        let instruction = subject.instruction(&self.language, seed);
        let images = render(&recording, &settings, stopped)?;
        Ok(images.map(|images| DatasetEpisode::new(task, instruction, index, &recording, images)))
    }
}

impl TaskQueue {
    fn new(task: TaskId, dataset: &DatasetWriter, dataset_idx: usize) -> Self {
        let (n_done, next) = dataset.progress(task.name());
        Self { task, dataset_idx, n_done, next, recording: VecDeque::new() }
    }
}

impl TaskYield {
    /// Counts the demonstrations of `task`. Tries after the last success do not count.
    fn new(task: TaskId, dataset: &DatasetWriter) -> Self {
        let (demonstrations, tries) = dataset.progress(task.name());
        let of_task = |episode: &&EpisodeRecord| episode.task == task.name();
        let frames = dataset.episodes().filter(of_task).map(|episode| episode.n_frames).sum();
        Self { task, demonstrations, tries, frames }
    }
}

fn table(yields: &[TaskYield]) -> String {
    use Align::{Left, Right};
    let columns = [
        ("task", Left),
        ("demonstrations", Right),
        ("tries", Right),
        ("yield", Right),
        ("frames", Right),
        ("mean_steps", Right),
    ];
    let mut table = TextTable::new(&columns);
    for TaskYield { task, demonstrations, tries, frames } in yields {
        let per = |n: f64, of: u32| n / f64::from(of.max(1));
        table.row(vec![
            task.name().to_owned(),
            demonstrations.to_string(),
            tries.to_string(),
            format!("{:.0} %", 100.0 * per(f64::from(*demonstrations), *tries)),
            frames.to_string(),
            format!("{:.1}", per(*frames as f64, *demonstrations)),
        ]);
    }
    table.to_string()
}
