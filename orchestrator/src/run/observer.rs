//! The receiver of the events of a run, which it hands on: to the results file, to the rule that ends cells
//! early, to the display and to the trace.

use run_config::trace;

use crate::fleet::{FleetEvent, Observer};
use crate::plan::jobs::Job;
use crate::run::live::LiveView;
use crate::run::recorder::Recorder;
use crate::run::stopping::Stopping;
use crate::run::trace_file::TraceFile;
use crate::store::shards::ShardTask;

/// Everything that follows the events of a run.
#[derive(Debug)]
pub(crate) struct RunObserver<'a> {
    pub(crate) recorder: Recorder<'a>,
    pub(crate) stopping: Option<Stopping>,
    pub(crate) live: LiveView,
    pub(crate) trace: Option<TraceFile>,
    /// The shard that is run, if it is one of a sweep.
    pub(crate) shard: Option<&'a ShardTask>,
}

impl Observer for RunObserver<'_> {
    fn on_event(&mut self, event: &FleetEvent<'_>) -> anyhow::Result<()> {
        self.recorder.on_event(event)?;
        if let Some(shard) = self.shard {
            shard.on_event(event, self.recorder.needs_images())?;
        }
        if let (Some(stopping), FleetEvent::EpisodeFinished(job, outcome)) = (&mut self.stopping, event) {
            stopping.on_finished(job, outcome.success());
        }
        self.live.on_event(event, self.stopping.as_ref());
        if let (Some(file), FleetEvent::Spans(process, spans)) = (&mut self.trace, event) {
            file.add(process, spans);
            file.add("orchestrator", &trace::take());
        }
        Ok(())
    }

    fn is_wanted(&mut self, job: &Job) -> bool {
        let is_wanted = self.stopping.as_ref().is_none_or(|stopping| stopping.is_wanted(job));
        if !is_wanted {
            self.live.on_skipped();
        }
        is_wanted
    }
}
