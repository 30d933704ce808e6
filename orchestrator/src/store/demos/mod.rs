//! Recording of demonstrations: successful episodes of the experts, as datasets that LeRobot can train on.

mod dataset;
mod image;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use ipc_types::Morphology;
use rayon::prelude::*;
use sim::TaskId;
use sim::demo::{DemoError, Recording};
use sim::perturb::Language;
use sim::render::{CpuRenderer, RenderScene};
use sim::scene::stream::episode_seed;
use sim::show::EpisodeSpec;

use self::dataset::{CameraImages, DatasetEpisode, DatasetWriter, EpisodeRecord};
pub(crate) use self::dataset::{DatasetSettings, StoredDataset};
pub(crate) use self::image::ImageFormat;
use crate::console::exit::ExitStatus;
use crate::console::output::{print_message, print_out};
use crate::console::progress::Progress;
use crate::console::table::{Align, TextTable};

/// Episodes that are recorded at a time per thread.
const EPISODES_PER_THREAD: u32 = 2;
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
        let started = Instant::now();
        let mut datasets = Vec::new();
        for morphology in Morphology::ALL {
            let own: Vec<TaskId> =
                self.tasks.iter().copied().filter(|task| task.task().morphology == morphology).collect();
            if !own.is_empty() {
                let dataset =
                    DatasetWriter::open(&folder.join(morphology.name()), self.settings_of(morphology))?;
                datasets.push((dataset, own));
            }
        }
        let done: u32 = datasets
            .iter()
            .flat_map(|(dataset, tasks)| {
                tasks.iter().map(|task| dataset.progress(task.name()).0.min(self.episodes))
            })
            .sum();
        let n = u64::from(self.episodes) * self.tasks.len() as u64;
        let frames_before: u64 = datasets.iter().map(|(dataset, _)| dataset.n_frames()).sum();
        let mut progress = Progress::of_demonstrations(n, u64::from(done), quiet);
        let mut yields = Vec::new();
        for (dataset, tasks) in &mut datasets {
            for &task in &*tasks {
                if !stopped.load(Ordering::Relaxed) {
                    self.demonstrate(task, dataset, &mut progress, stopped)?;
                }
            }
            dataset.write_meta()?;
            yields.extend(tasks.iter().map(|&task| TaskYield::new(task, dataset)));
        }
        progress.finish();
        let frames: u64 = datasets.iter().map(|(dataset, _)| dataset.n_frames()).sum();
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

    /// Records episode after episode until there are enough successes of this task.
    fn demonstrate(
        &self,
        task: TaskId,
        dataset: &mut DatasetWriter,
        progress: &mut Progress,
        stopped: &AtomicBool,
    ) -> anyhow::Result<()> {
        let (mut n_done, mut next) = dataset.progress(task.name());
        let max_tries = self.episodes.saturating_mul(MAX_TRIES_PER_DEMO).saturating_add(EXTRA_TRIES);
        while n_done < self.episodes && next < max_tries {
            let n_together = EPISODES_PER_THREAD * rayon::current_num_threads() as u32;
            let indices = next..(next + n_together).min(max_tries);
            next = indices.end;
            let recorded: Vec<Option<DatasetEpisode>> = indices
                .into_par_iter()
                .map(|index| self.episode(task, index, stopped))
                .collect::<anyhow::Result<_>>()?;
            if stopped.load(Ordering::Relaxed) {
                return Ok(());
            }
            for episode in recorded.into_iter().flatten().take((self.episodes - n_done) as usize) {
                dataset.push(episode)?;
                n_done += 1;
                progress.tick();
            }
        }
        if n_done < self.episodes {
            let name = task.name();
            progress.log(&format!(
                "{name}: {n_done} of {} demonstrations after {next} tries; giving up",
                self.episodes
            ));
        }
        dataset.close_file()
    }

    /// Records and renders the expert's episode of this index. Returns `None` if it does not succeed.
    fn episode(
        &self,
        task: TaskId,
        index: u32,
        stopped: &AtomicBool,
    ) -> anyhow::Result<Option<DatasetEpisode>> {
        let DatasetSettings {
            morphology,
            control_mode,
            perturbation,
            strength,
            profile,
            seed,
            images: format,
            protocol,
            ..
        } = self.settings_of(task.task().morphology);
        let subject = EpisodeSpec { task, perturbation, strength, profile };
        let seed = episode_seed(seed, task.name(), index);
        let recording = match Recording::of_expert(subject, seed, control_mode) {
            Ok(recording) if recording.success_at_end() => recording,
            Ok(_) | Err(DemoError::Plan(_) | DemoError::NotFinite { .. }) => return Ok(None),
            Err(error @ DemoError::Mode { .. }) => return Err(error.into()),
        };
        let mut renderer = CpuRenderer::new(rayon::current_num_threads());
        let view = RenderScene::new(recording.scene(), protocol.image_size);
        let mut images: Vec<CameraImages> =
            morphology.camera_names().iter().map(|_| CameraImages::default()).collect();
        for frame in 0..recording.n_frames() {
            if stopped.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let drawn = renderer.render_cameras(&view, recording.snapshot(frame));
            for (of_camera, (size, pixels)) in images.iter_mut().zip(drawn) {
                of_camera.push(&pixels, format.encode(&pixels, size)?);
            }
        }
        Ok(Some(DatasetEpisode {
            task: task.name().to_owned(),
            instruction: subject.instruction(&self.language, seed),
            index,
            fingerprint: recording.fingerprint(),
            actions: recording.actions().to_vec(),
            states: recording.states().to_vec(),
            images,
        }))
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
