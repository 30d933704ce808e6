//! The settings that LeRobot's policies have in common, and their features, normalisation
//! statistics and processors.

pub(crate) mod feature;
pub(crate) mod processor;
pub(crate) mod statistics;

use super::error::CheckpointError;
use super::settings::Settings;
use crate::policy::execution::ChunkSettings;

/// Settings of all policies that have no influence on actions.
const BASE_WITHOUT_INFLUENCE: [&str; 8] = [
    "device",
    "push_to_hub",
    "repo_id",
    "private",
    "tags",
    "license",
    "pretrained_path",
    "pretrained_revision",
];
/// Reads the settings that LeRobot's policies have in common and that could change actions.
pub(crate) fn read_base(settings: &mut Settings, notes: &mut Vec<String>) -> Result<(), CheckpointError> {
    settings.discard(&BASE_WITHOUT_INFLUENCE);
    let n_obs_steps = settings.take_or("n_obs_steps", 1)?;
    if n_obs_steps != 1 {
        return Err(settings.value("n_obs_steps", n_obs_steps, "1"));
    }
    settings.refuse_switch("use_peft", "false: merge the adapter into its base model")?;
    if settings.take("use_amp")? == Some(true) {
        notes.push("computes in f32, although `use_amp` asks LeRobot for mixed precision".to_owned());
    }
    Ok(())
}

/// Reads the size of a chunk and its use. `default` is LeRobot's default of both numbers of rows.
pub(crate) fn read_chunk(settings: &mut Settings, default: usize) -> Result<ChunkSettings, CheckpointError> {
    let horizon = settings.take_or("chunk_size", default)?;
    let execute = settings.take_or("n_action_steps", default)?;
    if execute == 0 || execute > horizon {
        return Err(settings.value(
            "n_action_steps",
            execute,
            format!("1 to `chunk_size`, which is {horizon}"),
        ));
    }
    Ok(ChunkSettings { horizon, execute: Some(execute), ensemble_decay: None })
}
