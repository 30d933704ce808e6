//! The outcome of an episode, as captions tell it.

/// Length of an episode and its success.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeStatus {
    /// First control step after which all success predicates held.
    pub first_success: Option<u32>,
    /// Number of control steps.
    pub n_steps: u32,
}

impl EpisodeStatus {
    /// Describes the state of the episode after `step` control steps.
    #[must_use]
    pub fn after(self, step: u32) -> String {
        let status = match self.first_success {
            Some(success) if success <= step => format!("success at step {success}"),
            _ if step < self.n_steps => "running".to_owned(),
            _ => "failed".to_owned(),
        };
        format!("step {step}, {status}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn description_follows_step_and_success() {
        let described = |first_success| {
            let outcome = EpisodeStatus { first_success, n_steps: 9 };
            [0, 6, 7, 9].map(|step| outcome.after(step))
        };
        let (failed, succeeded) = (described(None), described(Some(7)));
        assert_eq!(failed, ["step 0, running", "step 6, running", "step 7, running", "step 9, failed"]);
        assert_eq!(succeeded[..2], failed[..2]);
        assert_eq!(succeeded[2..], ["step 7, success at step 7", "step 9, success at step 7"]);
    }
}
