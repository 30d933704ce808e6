//! The measurement of one point.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::anyhow;

use crate::console::exit::{Failure, OrUser};
use crate::console::progress::Progress;
use crate::fleet::{FleetEvent, Stopper};
use crate::plan::jobs::JobList;
use crate::run::execution::{as_failure, fleet};
use crate::selection::policy::Identity;
use crate::store::results::FinishedEpisodes;
use crate::study::machine::Cores;
use crate::study::speed::plan::{PlannedPoint, SpeedPlan};
use crate::study::speed::point::SpeedPoint;

/// Stops the current fleet at the user's request, and tells that there was one.
#[derive(Clone, Debug, Default)]
pub(crate) struct StopControl(Arc<Mutex<StopState>>);

#[derive(Debug, Default)]
struct StopState {
    requested: bool,
    current: Option<Stopper>,
}

impl StopControl {
    /// Stops the current fleet and all that follow.
    pub(crate) fn request(&self) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.requested = true;
        if let Some(stopper) = &state.current {
            stopper.stop();
        }
    }

    /// Returns `true` after a request.
    pub(crate) fn is_requested(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).requested
    }

    fn watch(&self, stopper: Option<Stopper>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).current = stopper;
    }
}

/// Evaluates episodes in a fleet until the point is measured. Returns `None` if the user interrupts it.
pub(crate) fn measure(
    plan: &SpeedPlan,
    point: &PlannedPoint,
    identity: &Identity,
    cores: Cores,
    progress: &mut Progress,
    stop: &StopControl,
) -> Result<Option<SpeedPoint>, Failure> {
    let started = Instant::now();
    let todo = JobList::unfinished(&point.plan, FinishedEpisodes::default(), None);
    let fleet = fleet(&point.plan, std::slice::from_ref(identity), todo.len(), None, false)?;
    let stopper = fleet.stopper();
    stop.watch(Some(stopper.clone()));
    if stop.is_requested() {
        return Ok(None);
    }
    let (mut is_stopped, mut errors) = (false, 0);
    let mut observer = |event: &FleetEvent<'_>| {
        match event {
            FleetEvent::Counters(counters) => {
                progress.counters(counters);
                // A second stop would kill the children before they report their last steps.
                if !is_stopped && plan.is_enough(point, counters.env_steps, counters.wall_s) {
                    is_stopped = true;
                    stopper.stop();
                }
            }
            FleetEvent::EpisodeFinished(_, outcome) => errors += u64::from(outcome.error.is_some()),
            FleetEvent::Log(line) => progress.log(line),
            FleetEvent::RendererReady(_) | FleetEvent::Spans(..) => {}
        }
        Ok(())
    };
    let ended = fleet.run(&todo, &mut observer);
    stop.watch(None);
    let (_, totals) = ended.map_err(as_failure)?;
    if stop.is_requested() {
        return Ok(None);
    }
    let (series, envs) = (point.series.clone(), point.envs);
    let measured = SpeedPoint::new(series, envs, &totals, started.elapsed(), cores, errors);
    let no_step = || {
        anyhow!(
            "{}, {envs} envs: no control step; {errors} episodes ended with an error",
            point.series.name()
        )
    };
    measured.map(Some).ok_or_else(no_step).or_user()
}
