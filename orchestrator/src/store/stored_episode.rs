//! Episodes stored with their actions, in a dataset or in a results file: all that a replay needs except the
//! actions.

use ipc_types::{ControlMode, ImageSizes};
use sim::episode::EpisodeSpec;

/// A stored episode.
#[derive(Clone, Debug)]
pub(crate) struct StoredEpisode {
    /// Name of the policy that acted.
    pub(crate) policy: String,
    pub(crate) subject: EpisodeSpec,
    /// Index of the episode under the suite seed.
    pub(crate) index: u32,
    /// Seed of the episode.
    pub(crate) seed: u64,
    /// Control mode of the action rows.
    pub(crate) mode: ControlMode,
    /// Sizes of the images.
    pub(crate) images: ImageSizes,
    /// Number of control steps.
    pub(crate) n_steps: u32,
    /// Fingerprint of the trajectory, as [`format_fingerprint`] writes it.
    pub(crate) fingerprint: String,
}

impl StoredEpisode {
    /// Returns a description for messages.
    pub(crate) fn name(&self) -> String {
        let Self { policy, subject, index, .. } = self;
        format!("{policy}'s {} {} episode {index}", subject.task.name(), subject.perturbation.name())
    }

    /// Returns the number of values in all action rows `[n_steps, action_dim]`.
    pub(crate) fn n_action_values(&self) -> usize {
        self.n_steps as usize * self.mode.action_dim(self.subject.task.task().morphology)
    }
}

/// Returns a fingerprint as it is stored: 16 hexadecimal digits.
pub(crate) fn format_fingerprint(fingerprint: u64) -> String {
    format!("{fingerprint:016x}")
}
