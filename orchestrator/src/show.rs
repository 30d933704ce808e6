//! `hypogeum show`: what all cameras see when an episode starts, or along the expert's episode.

use std::path::PathBuf;

use anyhow::Context;
use sim::show::{Moments, contact_sheet};
use sim::stream::episode_seed;

use crate::cli::ShowArgs;
use crate::failure::{Ending, Failure, OrUser};
use crate::names::pick;
use crate::plan::{Condition, condition, perturbation, profile, task};
use crate::progress::print;

/// Draws the contact sheet.
pub(crate) fn show(args: &ShowArgs) -> Result<Ending, Failure> {
    let (task, perturbation) = (task(&args.task).or_user()?, perturbation(&args.perturbation).or_user()?);
    let Condition { task, perturbation } = condition(task, perturbation).or_user()?;
    let profile = profile(&args.profile).or_user()?;
    let moments = args.policy.as_deref().map_or(Ok(Moments::Start), |typed| {
        pick("policy to draw", typed, &[Moments::ExpertEpisode], |_| "expert")
    });
    let path = args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}.png", task.name())));
    let seed = episode_seed(args.seed, task.name(), args.episode);
    contact_sheet(task, perturbation, profile, seed, moments.or_user()?, &path)
        .with_context(|| format!("failed to show {}", task.name()))
        .or_user()?;
    print(&format!("wrote {}", path.display()));
    Ok(Ending::Done)
}
