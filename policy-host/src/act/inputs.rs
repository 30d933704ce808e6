//! The inputs of a network in an observation, as its mapping selects them.

use ipc_types::ObservationView;

use crate::checkpoint::ObservationMapping;
use crate::policy::PolicyError;

impl ObservationMapping {
    /// Checks that an observation has what the network needs.
    ///
    /// # Errors
    /// The first thing that is missing or differs.
    pub(crate) fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let Self { morphology, control_mode, cameras, .. } = self;
        if !cameras.is_empty() && !observation.has_images() {
            return Err(PolicyError::NoImages);
        }
        if observation.control_mode() != *control_mode {
            let (expected, found) = (control_mode.name(), observation.control_mode().name());
            return Err(PolicyError::ControlMode { expected, found });
        }
        (0..observation.n_envs()).try_for_each(|env_idx| {
            let (expected, found) = (morphology.state_dim(), observation.env(env_idx).state.len());
            if expected == found { Ok(()) } else { Err(PolicyError::StateDim { env_idx, expected, found }) }
        })
    }

    /// Writes the network's state input `[state_dim]` from the robot's state vector.
    pub(crate) fn gather_state(&self, state: &[f32], mut out: &mut [f32]) {
        for part in &self.state {
            let (own, others) = out.split_at_mut(part.len());
            own.copy_from_slice(&state[part.clone()]);
            out = others;
        }
    }
}
