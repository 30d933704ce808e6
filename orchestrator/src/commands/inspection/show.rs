//! `hypogeum show`: the images of all cameras at the start of episodes or along one, as a contact sheet or a
//! movie.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, ensure};
use clap::Args;
use ipc_types::ImageSizes;
use run_config::{Profile, Samples, Strength};
use sim::TaskId;
use sim::episode::EpisodeSpec;
use sim::perturb::Composition;
use sim::scene::stream::episode_seed;
use sim::show::movie::MovieFormat;
use sim::show::{Actor, FrameSequence, Legend, ViewMode, contact_sheet};

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::{print_message, print_out};
use crate::console::output_files::Overwriting;
use crate::console::table::{Align, TextTable};
use crate::console::threads::start_threads;
use crate::run::movie;
use crate::selection::condition::{Condition, ConditionError};
use crate::selection::names::{NameParser, UnknownName, pick};
use crate::selection::selectors::{PerturbationSelector, TaskSelector};

/// Arguments of `show`.
#[derive(Debug, Args)]
pub(crate) struct ShowArgs {
    /// Task; or all, single or bimanual: one image of each task on a single sheet, or three with --policy
    #[arg(value_parser = TaskSelector::PARSER, hide_possible_values = true)]
    pub(crate) task: TaskSelector,
    /// Perturbation, several joined by + that act together, or all: one row for each that applies to the task
    #[arg(long, default_value = "None", value_parser = PerturbationSelector::PARSER, hide_possible_values = true)]
    pub(crate) perturbation: PerturbationSelector,
    /// Strength of the perturbation, from 0.001 to 1
    #[arg(long, value_name = "X", default_value_t = Strength::FULL)]
    pub(crate) strength: Strength,
    /// Suite seed, as in `run`
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Index of the first episode under that seed
    #[arg(long, default_value_t = 0)]
    pub(crate) episode: u32,
    /// Show the starts of this many successive episodes, one row each
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64),
        conflicts_with_all = ["policy", "movie"])]
    pub(crate) episodes: u32,
    /// Reading of the benchmark where its paper and its released code disagree
    #[arg(long, value_enum, ignore_case = true, default_value_t = Profile::Strict)]
    pub(crate) profile: Profile,
    /// Image content. rgb: the images that policies receive; depth: log depth in viridis, near bright, within
    /// 0.05 to 4 m (the range is printed); seg: one colour per body, arm, table, floor and walls (the legend
    /// is printed). Background is black
    #[arg(long, value_name = "VIEW", default_value = "rgb", value_parser = VIEW_PARSER)]
    pub(crate) what: ViewMode,
    /// Samples per pixel of rgb images
    #[arg(long, value_enum, default_value_t = Samples::One)]
    pub(crate) samples: Samples,
    /// Size of the images in pixels: WxH, or WxH,wrist=WxH
    #[arg(long, value_name = "WxH[,wrist=WxH]", default_value_t = ImageSizes::BENCHMARK)]
    pub(crate) image_size: ImageSizes,
    /// Show only this camera, counted from 1 in the order of the columns; a sheet shows several per row.
    /// A sheet of several tasks shows the first external camera, or the second if it sees more objects
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=4))]
    pub(crate) camera: Option<u8>,
    /// Let this policy act, and show the start, the middle and the success (or end) of the episode
    #[arg(long, value_name = "SPEC", value_parser = ACTOR_PARSER)]
    pub(crate) policy: Option<Actor>,
    /// Write the whole episode, 20 control steps per second, as .png or .apng (lossless), .gif (small) or
    /// .mp4 (smallest; needs ffmpeg); the expert acts unless --policy is given
    #[arg(long, value_name = "FILE")]
    pub(crate) movie: Option<PathBuf>,
    /// Contact sheet to write [default: TASK.png]
    #[arg(short, long, value_name = "FILE.png", conflicts_with = "movie")]
    pub(crate) output: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) overwriting: Overwriting,
}

const VIEW_PARSER: NameParser<ViewMode, UnknownName> = NameParser {
    parse: |typed| pick("view", typed, &ViewMode::ALL, ViewMode::name),
    names: || ViewMode::ALL.map(ViewMode::name).to_vec(),
};

const ACTOR_PARSER: NameParser<Actor, UnknownName> = NameParser {
    parse: |typed| pick("policy to show", typed, &Actor::ALL, Actor::name),
    names: || Actor::ALL.map(Actor::name).to_vec(),
};

/// Tasks per row of a sheet with one image each, and with three.
const GALLERY_COLUMNS: [usize; 2] = [7, 3];

/// The resolved arguments.
struct ShowPlan {
    /// Episodes of one task, at least one, each with its seed.
    episodes: Vec<(EpisodeSpec, u64)>,
    what: ViewMode,
    samples: Samples,
    images: ImageSizes,
    /// The policy that acts; `None` to show the starts only.
    actor: Option<Actor>,
    /// The only camera shown, if not all are.
    camera_idx: Option<usize>,
    /// Title of each episode.
    titles: Vec<String>,
}

/// Renders the contact sheet or the movie.
pub(crate) fn show(args: &ShowArgs) -> Result<ExitStatus, Failure> {
    start_threads()?;
    let TaskSelector::Task(task) = args.task else {
        return write_gallery(args).context("failed to show the gallery").or_user();
    };
    let plan = ShowPlan::new(task, args).or_user()?;
    let name = task.name();
    let sheet = || args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.png")));
    let path = args.movie.clone().unwrap_or_else(sheet);
    args.overwriting.check(&path).or_user()?;
    if args.movie.is_some() { write_movie(&plan, &path) } else { write_sheet(&plan, &path) }
        .with_context(|| format!("failed to show {name}"))
        .or_user()
}

impl ShowPlan {
    fn new(task: TaskId, args: &ShowArgs) -> anyhow::Result<Self> {
        let &ShowArgs { strength, profile, what, samples, image_size: images, policy: actor, .. } = args;
        let camera_idx = args.camera.map(|number| usize::from(number) - 1);
        let n_cameras = (task.task().nominal)(profile).cameras.len();
        ensure!(camera_idx.is_none_or(|idx| idx < n_cameras), "{} has {n_cameras} cameras", task.name());
        let perturbations = perturbations(task, args.perturbation)?;
        if perturbations.len() > 1 && (args.episodes > 1 || actor.is_some() || args.movie.is_some()) {
            let message =
                "--perturbation all shows the start of one episode: omit --episodes, --policy and --movie";
            return Err(anyhow!(message));
        }
        let subject = |perturbation| EpisodeSpec { task, perturbation, profile, strength };
        let (mut episodes, mut titles) = (Vec::new(), Vec::new());
        for &perturbation in &perturbations {
            for idx in (args.episode..=u32::MAX).take(args.episodes as usize) {
                let subject = subject(perturbation);
                titles.push(match (perturbations.len(), args.episodes) {
                    (1, 1) => subject.title(),
                    (1, _) => format!("{}, episode {idx}", subject.title()),
                    _ => perturbation.name(),
                });
                episodes.push((subject, episode_seed(args.seed, task.name(), idx)));
            }
        }
        Ok(Self { episodes, what, samples, images, actor, camera_idx, titles })
    }

    /// Applies the number of samples and the choice of camera.
    fn prepared(&self, frames: FrameSequence) -> FrameSequence {
        let frames = frames.with_samples(self.samples);
        match self.camera_idx {
            Some(idx) => frames.with_camera(idx),
            None => frames,
        }
    }
}

/// Returns the perturbations that `selector` selects for `task`, at least one.
fn perturbations(task: TaskId, selector: PerturbationSelector) -> Result<Vec<Composition>, ConditionError> {
    match selector {
        PerturbationSelector::Applicable => {
            Ok(Condition::all_of(task).map(|condition| condition.perturbation).collect())
        }
        PerturbationSelector::Named(perturbation) => {
            Ok(vec![Condition::new(task, perturbation)?.perturbation])
        }
    }
}

/// Writes one PNG: a row of camera images for the start of each episode, or for three moments of one.
fn write_sheet(plan: &ShowPlan, path: &Path) -> anyhow::Result<ExitStatus> {
    let &ShowPlan { ref episodes, what, images, actor, .. } = plan;
    let (subject, seed) = episodes[0];
    let frames = match actor {
        None => FrameSequence::initial_states(episodes, what, images).with_titles(plan.titles.clone()),
        Some(actor) => FrameSequence::highlights(subject, seed, actor, what, images)?,
    };
    let mut frames = plan.prepared(frames);
    frames.render_sheet().write_png(path)?;
    if episodes.iter().any(|(other, _)| other.perturbation != subject.perturbation) {
        let mut rows = TextTable::new(&[("row", Align::Left), ("instruction", Align::Left)]);
        for ((subject, _), instruction) in episodes.iter().zip(frames.instructions()) {
            rows.row(vec![subject.perturbation.name(), instruction.clone()]);
        }
        print_out(&rows.to_string())?;
    }
    print_legend(frames.legend(), path)
}

/// Writes one PNG with the image of an external camera at the start of an episode of each selected task, or
/// at three moments.
fn write_gallery(args: &ShowArgs) -> anyhow::Result<ExitStatus> {
    let &ShowArgs { strength, profile, what, samples, image_size: images, policy: actor, .. } = args;
    if args.camera.is_some() || args.movie.is_some() || args.episodes > 1 || what != ViewMode::Rgb {
        let message = "a sheet of several tasks shows rgb images of one episode of each: omit --camera, --movie, \
                       --episodes and --what, or name one task";
        return Err(anyhow!(message));
    }
    let PerturbationSelector::Named(perturbation) = args.perturbation else {
        return Err(anyhow!("a sheet of several tasks shows one perturbation: name it instead of `all`"));
    };
    let mut panels = Vec::new();
    for task in TaskSelector::select(&[args.task]) {
        let perturbation = Condition::new(task, perturbation)?.perturbation;
        let seed = episode_seed(args.seed, task.name(), args.episode);
        let episode = EpisodeSpec { task, perturbation, profile, strength };
        let frames = match actor {
            None => FrameSequence::initial_states(&[(episode, seed)], what, images),
            Some(actor) => FrameSequence::highlights(episode, seed, actor, what, images)?,
        };
        panels.push(frames.with_samples(samples).with_clearest_camera().render_strip());
    }
    let path = args.output.as_deref().unwrap_or(Path::new("tasks.png"));
    args.overwriting.check(path)?;
    let columns = GALLERY_COLUMNS[usize::from(actor.is_some())];
    contact_sheet::compose(&panels, columns, 1).write_png(path)?;
    print_message(&format!("wrote {}", path.display()));
    Ok(ExitStatus::Success)
}

/// Writes one frame per control step of one episode.
fn write_movie(plan: &ShowPlan, path: &Path) -> anyhow::Result<ExitStatus> {
    let (subject, seed) = plan.episodes[0];
    let format = MovieFormat::from_path(path)?;
    let actor = plan.actor.unwrap_or(Actor::Expert);
    let mut frames = plan.prepared(FrameSequence::episode(subject, seed, actor, plan.what, plan.images)?);
    match movie::write(path, format, frames.n_frames(), 1, |frame_idx| frames.render_frame(frame_idx))? {
        ExitStatus::Success => print_legend(frames.legend(), path),
        other => Ok(other),
    }
}

/// Prints the meaning of the colours to stdout and the path of the file to stderr.
fn print_legend(legend: &Legend, path: &Path) -> anyhow::Result<ExitStatus> {
    match legend {
        Legend::Rgb => {}
        Legend::Depth(range) => print_out(&format!("depth {range}\n"))?,
        Legend::Seg(entries) => {
            let mut table = TextTable::new(&[("object", Align::Left), ("colour", Align::Left)]);
            for entry in entries {
                let [r, g, b] = entry.color;
                table.row(vec![entry.name.clone(), format!("#{r:02x}{g:02x}{b:02x}")]);
            }
            print_out(&table.to_string())?;
        }
    }
    print_message(&format!("wrote {}", path.display()));
    Ok(ExitStatus::Success)
}
