//! `hypogeum show`: what all cameras see at the starts of episodes or along one, as a sheet or as a movie.

use std::path::{Path, PathBuf};

use anyhow::Context;
use sim::TaskId;
use sim::perturb::Composition;
use sim::show::movie::MovieFormat;
use sim::show::{Actor, EpisodeSpec, FrameSequence, Legend, ViewMode};
use sim::stream::episode_seed;

use crate::cli::ShowArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::movie;
use crate::plan::{Condition, PlanError};
use crate::progress::print;
use crate::report::{Align, Table, print_out};
use crate::selection::PerturbationSelector;

/// What to show, as meant.
struct Wish {
    /// Episodes of one task, at least one: a subject and a seed each.
    episodes: Vec<(EpisodeSpec, u64)>,
    what: ViewMode,
    /// Who acts; `None` for the starts alone.
    script: Option<Actor>,
}

/// Draws the sheet or the movie.
pub(crate) fn show(args: &ShowArgs) -> Result<Ending, Failure> {
    let wish = Wish::new(args)?;
    let name = wish.episodes[0].0.task.name();
    match &args.movie {
        Some(path) => draw_movie(&wish, path),
        None => sheet(&wish, args.output.as_deref().unwrap_or(&PathBuf::from(format!("{name}.png")))),
    }
    .with_context(|| format!("failed to show {name}"))
    .or_user()
}

impl Wish {
    fn new(args: &ShowArgs) -> Result<Self, Failure> {
        let &ShowArgs { task, strength, profile, what, policy: script, .. } = args;
        let perturbations = perturbations(task, args.perturbation).or_user()?;
        if perturbations.len() > 1 && (args.episodes > 1 || args.policy.is_some() || args.movie.is_some()) {
            let message = "--perturbation all shows the start of one episode: leave out --episodes, --policy and --movie";
            return Err(Failure::User(anyhow::anyhow!(message)));
        }
        let subject = |perturbation| EpisodeSpec { task, perturbation, profile, strength };
        let episodes = (args.episode..=u32::MAX).take(args.episodes as usize);
        let seeds: Vec<u64> = episodes.map(|idx| episode_seed(args.seed, task.name(), idx)).collect();
        let rows = perturbations
            .iter()
            .flat_map(|perturbation| seeds.iter().map(move |seed| (*perturbation, *seed)));
        Ok(Self {
            episodes: rows.map(|(perturbation, seed)| (subject(perturbation), seed)).collect(),
            what,
            script,
        })
    }
}

/// Returns the perturbations that `selector` selects for `task`, at least one.
fn perturbations(task: TaskId, selector: PerturbationSelector) -> Result<Vec<Composition>, PlanError> {
    match selector {
        PerturbationSelector::Applicable => {
            Ok(Condition::all_of(task).map(|condition| condition.perturbation).collect())
        }
        PerturbationSelector::Named(perturbation) => {
            Ok(vec![Condition::new(task, perturbation)?.perturbation])
        }
    }
}

/// One PNG: a row of cameras for the start of each episode, or for three moments along one.
fn sheet(wish: &Wish, path: &Path) -> anyhow::Result<Ending> {
    let &Wish { ref episodes, what, script } = wish;
    let (subject, seed) = episodes[0];
    let mut film = match script {
        None => FrameSequence::initial_states(episodes, what),
        Some(script) => FrameSequence::highlights(subject, seed, script, what)?,
    };
    film.render_sheet().write_png(path)?;
    if episodes.iter().any(|(other, _)| other.perturbation != subject.perturbation) {
        let mut rows = Table::new(&[("row", Align::Left), ("instruction", Align::Left)]);
        for ((subject, _), instruction) in episodes.iter().zip(film.instructions()) {
            rows.row(vec![subject.perturbation.name(), instruction.clone()]);
        }
        print_out(&rows.to_string())?;
    }
    tell(film.legend(), path)
}

/// A frame per control step of one episode.
fn draw_movie(wish: &Wish, path: &Path) -> anyhow::Result<Ending> {
    let &Wish { ref episodes, what, script } = wish;
    let (subject, seed) = episodes[0];
    let format = MovieFormat::from_path(path)?;
    let mut film = FrameSequence::episode(subject, seed, script.unwrap_or(Actor::Expert), what)?;
    match movie::write(path, format, film.n_frames(), |frame_idx| film.render_frame(frame_idx))? {
        Ending::Done => tell(film.legend(), path),
        other => Ok(other),
    }
}

/// What the colours mean goes to stdout, where the file is to stderr.
fn tell(key: &Legend, path: &Path) -> anyhow::Result<Ending> {
    match key {
        Legend::Rgb => {}
        Legend::Depth(range) => print_out(&format!("depth {range}\n"))?,
        Legend::Seg(entries) => {
            let mut table = Table::new(&[("thing", Align::Left), ("colour", Align::Left)]);
            for entry in entries {
                let [r, g, b] = entry.color;
                table.row(vec![entry.name.clone(), format!("#{r:02x}{g:02x}{b:02x}")]);
            }
            print_out(&table.to_string())?;
        }
    }
    print(&format!("wrote {}", path.display()));
    Ok(Ending::Done)
}
