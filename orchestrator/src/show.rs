//! `hypogeum show`: what all cameras see at the starts of episodes or along one, as a sheet or as a movie.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use sim::show::movie::{Format, Movie};
use sim::show::{Film, Key, Script, Subject, What};
use sim::stream::episode_seed;

use crate::cli::ShowArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::interrupt;
use crate::names::pick;
use crate::plan::{Condition, condition, perturbation, profile, strength, task};
use crate::progress::{Progress, print};
use crate::report::{Align, Table, print_out};

/// What to show, as meant.
struct Wish {
    subject: Subject,
    /// Of the episodes in their order, at least one.
    episode_seeds: Vec<u64>,
    what: What,
    /// Who acts; `None` for the starts alone.
    script: Option<Script>,
}

/// Draws the sheet or the movie.
pub(crate) fn show(args: &ShowArgs) -> Result<Ending, Failure> {
    let wish = Wish::new(args)?;
    let name = wish.subject.task.name();
    match &args.movie {
        Some(path) => movie(&wish, path),
        None => sheet(&wish, args.output.as_deref().unwrap_or(&PathBuf::from(format!("{name}.png")))),
    }
    .with_context(|| format!("failed to show {name}"))
    .or_user()
}

impl Wish {
    fn new(args: &ShowArgs) -> Result<Self, Failure> {
        let (task, perturbation) = (task(&args.task).or_user()?, perturbation(&args.perturbation).or_user()?);
        let Condition { task, perturbation } = condition(task, perturbation).or_user()?;
        let strength = strength(args.strength).or_user()?;
        let profile = profile(&args.profile).or_user()?;
        let what = pick("view", &args.what, &What::ALL, What::name).or_user()?;
        let script = |typed: &String| pick("policy to show", typed, &Script::ALL, Script::name);
        let episodes = (args.episode..=u32::MAX).take(args.episodes as usize);
        Ok(Self {
            subject: Subject { task, perturbation, profile, strength },
            episode_seeds: episodes.map(|idx| episode_seed(args.seed, task.name(), idx)).collect(),
            what,
            script: args.policy.as_ref().map(script).transpose().or_user()?,
        })
    }
}

/// One PNG: a row of cameras for the start of each episode, or for three moments along one.
fn sheet(wish: &Wish, path: &Path) -> anyhow::Result<Ending> {
    let &Wish { subject, ref episode_seeds, what, script } = wish;
    let mut film = match script {
        None => Film::of_starts(subject, episode_seeds, what),
        Some(script) => Film::of_highlights(subject, episode_seeds[0], script, what)?,
    };
    film.sheet().write_png(path)?;
    tell(film.key(), path)
}

/// A frame per control step of one episode.
fn movie(wish: &Wish, path: &Path) -> anyhow::Result<Ending> {
    let &Wish { subject, ref episode_seeds, what, script } = wish;
    let format = Format::of(path)?;
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let _watch = interrupt::watch(move || stop.store(true, Ordering::Relaxed))
        .context("failed to watch for signals")?;
    let mut film = Film::of_episode(subject, episode_seeds[0], script.unwrap_or(Script::Expert), what)?;
    let mut progress = Progress::of_frames(film.n_moments() as u64);
    let mut movie = Movie::begin(path, format, film.n_moments(), film.picture(0))?;
    progress.tick();
    for moment_idx in 1..film.n_moments() {
        if stopped.load(Ordering::Relaxed) {
            progress.finish();
            print(&format!("interrupted; {} is not written", path.display()));
            return Ok(Ending::Interrupted);
        }
        movie.push(film.picture(moment_idx))?;
        progress.tick();
    }
    movie.finish()?;
    progress.finish();
    tell(film.key(), path)
}

/// What the colours mean goes to stdout, where the file is to stderr.
fn tell(key: &Key, path: &Path) -> anyhow::Result<Ending> {
    match key {
        Key::Rgb => {}
        Key::Depth(range) => print_out(&format!("depth {range}\n"))?,
        Key::Seg(entries) => {
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
