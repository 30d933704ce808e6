//! `hypogeum demos`: the experts' successes as datasets that LeRobot trains on.

mod dataset;
mod image;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::Context;
use ipc_types::Morphology;
use rayon::prelude::*;
use sim::TaskId;
use sim::demo::{DemoError, Recording};
use sim::render::{CpuRenderer, RenderScene};
use sim::show::EpisodeSpec;
use sim::stream::episode_seed;

pub(crate) use self::dataset::Stored;
use self::dataset::{Dataset, Episode, EpisodeRecord, Images, Settings};
pub(crate) use self::image::ImageFormat;
use crate::cli::DemosArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::interrupt;
use crate::plan::Condition;
use crate::progress::{Progress, print};
use crate::report::{Align, Table, print_out};
use crate::selection::TaskSelector;

/// Episodes that are made at a time, for each thread.
const EPISODES_PER_THREAD: u32 = 2;
/// A task is given up when it has been tried so many times as often as is wanted, and a few times more.
const MOST_TRIES: u32 = 10;
const FEW_TRIES: u32 = 20;

/// What is wanted, as meant.
struct Wish {
    tasks: Vec<TaskId>,
    /// Demonstrations of each task.
    episodes: u32,
    /// What the episodes of one arm share. Those of two differ in morphology and control mode.
    single_arm: Settings,
}

/// What became of a task.
struct Yield {
    task: TaskId,
    demonstrations: u32,
    tries: u32,
    frames: u64,
}

/// Makes demonstrations until there are as many as wanted.
pub(crate) fn demos(args: &DemosArgs) -> Result<Ending, Failure> {
    let wish = Wish::new(args)?;
    let threads = match args.threads {
        Some(threads) => threads as usize,
        None => std::thread::available_parallelism().context("failed to count the cores").or_user()?.get(),
    };
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().context("failed to start threads")?;
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let _watch = interrupt::watch(move || stop.store(true, Ordering::Relaxed))
        .context("failed to watch for signals")?;
    pool.install(|| wish.run(&args.output, args.quiet, &stopped)).or_user()
}

impl Wish {
    fn new(args: &DemosArgs) -> Result<Self, Failure> {
        let &DemosArgs { perturbation, strength, profile, control_mode, seed, images, .. } = args;
        let tasks = TaskSelector::select(&args.tasks);
        for &task in &tasks {
            Condition::new(task, perturbation).or_user()?;
        }
        let single_arm = Settings {
            morphology: Morphology::Single,
            control_mode,
            perturbation,
            strength,
            profile,
            seed,
            images,
        };
        Ok(Self { tasks, episodes: args.episodes, single_arm })
    }

    fn settings_of(&self, morphology: Morphology) -> Settings {
        let control_mode = morphology.control_mode(self.single_arm.control_mode);
        Settings { morphology, control_mode, ..self.single_arm }
    }

    fn run(&self, folder: &Path, quiet: bool, stopped: &AtomicBool) -> anyhow::Result<Ending> {
        let started = Instant::now();
        let mut datasets = Vec::new();
        for morphology in Morphology::ALL {
            let own: Vec<TaskId> =
                self.tasks.iter().copied().filter(|task| task.task().morphology == morphology).collect();
            if !own.is_empty() {
                let dataset = Dataset::open(&folder.join(morphology.name()), self.settings_of(morphology))?;
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
            yields.extend(tasks.iter().map(|&task| Yield::of(task, dataset)));
        }
        progress.finish();
        let frames: u64 = datasets.iter().map(|(dataset, _)| dataset.n_frames()).sum();
        let seconds = started.elapsed().as_secs_f64();
        print_out(&table(&yields))?;
        print(&format!(
            "{}: {frames} frames, {:.1} per second of the {seconds:.0} s just now",
            folder.display(),
            (frames - frames_before) as f64 / seconds
        ));
        if stopped.load(Ordering::Relaxed) {
            print("interrupted; the same command goes on from here");
            return Ok(Ending::Interrupted);
        }
        let short = yields.iter().any(|own| own.demonstrations < self.episodes);
        Ok(if short { Ending::WithErrors } else { Ending::Done })
    }

    /// Tries episode after episode until there are enough successes of this task.
    fn demonstrate(
        &self,
        task: TaskId,
        dataset: &mut Dataset,
        progress: &mut Progress,
        stopped: &AtomicBool,
    ) -> anyhow::Result<()> {
        let (mut n_done, mut next) = dataset.progress(task.name());
        let most_tries = self.episodes.saturating_mul(MOST_TRIES).saturating_add(FEW_TRIES);
        while n_done < self.episodes && next < most_tries {
            let n_together = EPISODES_PER_THREAD * rayon::current_num_threads() as u32;
            let indices = next..(next + n_together).min(most_tries);
            next = indices.end;
            let made: Vec<Option<Episode>> = indices
                .into_par_iter()
                .map(|index| self.episode(task, index, stopped))
                .collect::<anyhow::Result<_>>()?;
            if stopped.load(Ordering::Relaxed) {
                return Ok(());
            }
            for episode in made.into_iter().flatten().take((self.episodes - n_done) as usize) {
                dataset.push(episode)?;
                n_done += 1;
                progress.tick();
            }
        }
        if n_done < self.episodes {
            let name = task.name();
            progress.log(&format!(
                "{name}: {n_done} of {} demonstrations in {next} tries; given up",
                self.episodes
            ));
        }
        dataset.close_file()
    }

    /// The expert's episode of this index, drawn, if it succeeds.
    fn episode(&self, task: TaskId, index: u32, stopped: &AtomicBool) -> anyhow::Result<Option<Episode>> {
        let Settings { morphology, control_mode, perturbation, strength, profile, seed, images: format } =
            self.settings_of(task.task().morphology);
        let subject = EpisodeSpec { task, perturbation, strength, profile };
        let seed = episode_seed(seed, task.name(), index);
        let recording = match Recording::of_expert(subject, seed, control_mode) {
            Ok(recording) if recording.success_at_end() => recording,
            Ok(_) | Err(DemoError::Plan(_) | DemoError::NotFinite { .. }) => return Ok(None),
            Err(error @ DemoError::Mode { .. }) => return Err(error.into()),
        };
        let mut renderer = CpuRenderer::new(rayon::current_num_threads());
        let view = RenderScene::new(recording.scene());
        let mut images: Vec<Images> = morphology.camera_names().iter().map(|_| Images::default()).collect();
        for frame in 0..recording.n_frames() {
            if stopped.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let drawn = renderer.photograph(&view, recording.snapshot(frame));
            for (of_camera, (side, pixels)) in images.iter_mut().zip(drawn) {
                of_camera.push(&pixels, format.encode(&pixels, side)?);
            }
        }
        Ok(Some(Episode {
            task: task.name().to_owned(),
            instruction: recording.instruction().to_owned(),
            index,
            fingerprint: recording.fingerprint(),
            actions: recording.actions().to_vec(),
            states: recording.states().to_vec(),
            images,
        }))
    }
}

impl Yield {
    /// As the dataset has it; tries after the last success are not counted.
    fn of(task: TaskId, dataset: &Dataset) -> Self {
        let (demonstrations, tries) = dataset.progress(task.name());
        let of_task = |episode: &&EpisodeRecord| episode.task == task.name();
        let frames = dataset.episodes().filter(of_task).map(|episode| episode.n_frames).sum();
        Self { task, demonstrations, tries, frames }
    }
}

fn table(yields: &[Yield]) -> String {
    use Align::{Left, Right};
    let columns = [
        ("task", Left),
        ("demonstrations", Right),
        ("tries", Right),
        ("yield", Right),
        ("frames", Right),
        ("mean_steps", Right),
    ];
    let mut table = Table::new(&columns);
    for Yield { task, demonstrations, tries, frames } in yields {
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
