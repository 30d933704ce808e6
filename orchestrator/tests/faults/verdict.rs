//! The verdict on a finished run: its result must follow from what has happened.

use super::super::error::FleetError;
use super::super::{RunStatus, Totals};
use super::history::{EndCause, RunHistory};
use crate::fleet::processes::member::MemberRole;

impl RunHistory<'_> {
    /// Checks the result of a run.
    pub(crate) fn check_result(&self, result: &Result<(RunStatus, Totals), FleetError>) {
        let has = |cause| self.causes.contains(&cause);
        let ends: Vec<_> = self.causes.iter().filter(|cause| **cause != EndCause::Stop).collect();
        assert!(result.is_err() || ends.is_empty(), "the run ended without an error despite {ends:?}");
        match result {
            Ok((RunStatus::Complete, totals)) => self.check_complete(totals),
            Ok((RunStatus::Stopped, _)) => assert!(has(EndCause::Stop), "nobody has requested a stop"),
            Err(error) => {
                let is_justified = match error {
                    FleetError::Observer(_) => has(EndCause::DiskFull),
                    FleetError::Spawn { .. } => has(EndCause::SpawnFailed),
                    FleetError::Intruder { .. } => has(EndCause::Intruder),
                    FleetError::Shortage { .. } => has(EndCause::Shortage),
                    FleetError::Renderer(_) => has(EndCause::RendererFailed),
                    FleetError::RendererChanged { .. } => has(EndCause::RendererChanged),
                    FleetError::Vanished { .. } => has(EndCause::Vanished),
                    FleetError::Stuck { .. } => self.scenario.config.can_move && !self.scenario.is_quiet(),
                    FleetError::Child { name, .. }
                    | FleetError::CpuTime { name }
                    | FleetError::OutOfMemory { name, .. }
                    | FleetError::Ended { name, .. }
                    | FleetError::TooManyFailures { name, .. } => {
                        let role = self.role_named(name);
                        self.failed.contains(&role) && (role == MemberRole::Sim || self.drivers().len() == 1)
                    }
                    FleetError::Lane(_) => {
                        let lanes = 0..self.scenario.config.lanes.len() as u32;
                        let mut foreign = lanes.filter(|lane| self.is_foreign(*lane));
                        self.drivers().len() == 1
                            && foreign.any(|lane| self.failed.contains(&MemberRole::Host(lane)))
                    }
                    _ => false,
                };
                assert!(is_justified, "the run ended without a reason: {error}");
            }
        }
    }

    fn check_complete(&self, totals: &Totals) {
        for (idx, is_recorded) in self.recorded.iter().enumerate() {
            let is_wanted = !self.scenario.unwanted.contains(&idx);
            assert_eq!(*is_recorded, is_wanted, "job {idx}: recorded and wanted");
        }
        assert_eq!(totals.restarts, self.n_restarts, "number of children that ended during the run");
        if self.scenario.is_quiet() {
            let is_single = self.roles.values().all(|role| role.n_spawns <= 1);
            assert!(is_single && self.n_kills == 0, "a child was replaced although nothing happened");
            assert_eq!(self.n_runs as usize, self.scenario.n_wanted(), "number of assigned episodes");
        }
    }

    fn role_named(&self, name: &str) -> MemberRole {
        let lanes = self.scenario.config.lanes.iter();
        let lane = lanes.map(|policy| &policy.lane.spec).find(|spec| name.contains(&spec.policy));
        lane.map_or(MemberRole::Sim, |spec| MemberRole::Host(spec.lane))
    }
}
