//! The trace file of a run: what the threads of all processes did and when, in Chrome's trace event format,
//! which Perfetto (ui.perfetto.dev) and chrome://tracing open.
//!
//! The file is an array of events, one per line, that grows while the run goes on. The format allows the
//! closing bracket to be missing, so the trace of an interrupted run is readable as well. If the file cannot
//! be written any more, the run goes on without it and reports that in the end.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use run_config::trace::{Activity, TraceSpan};
use serde_json::{Value, json};
use sim::show::MARK;

use crate::console::output_files::Overwriting;

/// A trace file that is being written.
#[derive(Debug)]
pub(crate) struct TraceFile {
    path: PathBuf,
    file: BufWriter<File>,
    /// Ids of the processes, by name. A restarted child goes on under its name.
    processes: HashMap<String, usize>,
    /// Start of the first span, which is time 0.
    origin_ns: Option<u64>,
    n_in_flight: u64,
    /// Text before the next event.
    separator: &'static str,
    /// The first error; nothing is written after it.
    failure: Option<io::Error>,
}

impl TraceFile {
    /// Creates the file, or empties that of an earlier run.
    ///
    /// # Errors
    /// If that fails, or it is another file.
    pub(crate) fn create(path: &Path) -> anyhow::Result<Self> {
        Overwriting::default().check(path)?;
        let file = File::create(path).with_context(|| format!("failed to create {}", path.display()))?;
        let mut trace = Self {
            path: path.to_owned(),
            file: BufWriter::new(file),
            processes: HashMap::new(),
            origin_ns: None,
            n_in_flight: 0,
            separator: "\n",
            failure: None,
        };
        trace.write("[");
        trace.write_event(
            &json!({ "name": "process_labels", "ph": "M", "pid": 0, "args": { "labels": MARK } }),
        );
        Ok(trace)
    }

    /// Appends spans of a process.
    pub(crate) fn add(&mut self, process: &str, spans: &[TraceSpan]) {
        let Some(first) = spans.iter().map(|span| span.start_ns).min() else { return };
        let origin_ns = *self.origin_ns.get_or_insert(first);
        let next = self.processes.len() + 1;
        let pid = *self.processes.entry(process.to_owned()).or_insert(next);
        if pid == next {
            self.write_event(
                &json!({ "name": "process_name", "ph": "M", "pid": pid, "args": { "name": process } }),
            );
        }
        for span in spans {
            let TraceSpan { activity, thread, start_ns, duration_ns, n } = *span;
            // Children record from their start, and a process may report before another that started earlier.
            let start_us = (start_ns as f64 - origin_ns as f64) / 1e3;
            let duration_us = duration_ns as f64 / 1e3;
            let mut event =
                json!({ "name": activity, "pid": pid, "tid": thread, "ts": start_us, "args": { "n": n } });
            if activity == Activity::InFlight {
                // Batches in flight overlap, so they are asynchronous events: a start and an end with an id.
                self.n_in_flight += 1;
                event["cat"] = json!("batch");
                event["id"] = json!(self.n_in_flight);
                event["ph"] = json!("b");
                self.write_event(&event);
                event["ph"] = json!("e");
                event["ts"] = json!(start_us + duration_us);
            } else {
                event["ph"] = json!("X");
                event["dur"] = json!(duration_us);
            }
            self.write_event(&event);
        }
    }

    /// Ends the file.
    ///
    /// # Errors
    /// If it could not be written as a whole.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        self.write("\n]\n");
        let written = self.failure.map_or_else(|| self.file.flush(), Err);
        written.with_context(|| {
            format!("failed to write the trace {}; the results are complete", self.path.display())
        })
    }

    fn write_event(&mut self, event: &Value) {
        let separator = std::mem::replace(&mut self.separator, ",\n");
        self.write(&format!("{separator}{event}"));
    }

    fn write(&mut self, text: &str) {
        if self.failure.is_none() {
            self.failure = self.file.write_all(text.as_bytes()).err();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trace_has_processes_spans_and_batches() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        let mut trace = TraceFile::create(&path).unwrap();
        let span =
            |activity, start_ns, duration_ns, n| TraceSpan { activity, thread: 2, start_ns, duration_ns, n };
        trace.add("sim", &[span(Activity::Step, 5_000, 2_000, 5), span(Activity::InFlight, 6_000, 9_000, 8)]);
        trace.add("host of `act`", &[span(Activity::Infer, 7_000, 6_500, 8)]);
        trace.add("sim", &[]);
        trace.finish().unwrap();
        let events: Vec<Value> = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        // Viewers refuse events without a phase.
        assert!(events.iter().all(|event| event["ph"].is_string()), "{events:?}");
        let of =
            |name: &str| -> Vec<&Value> { events.iter().filter(|event| event["name"] == name).collect() };
        assert_eq!(of("process_name").len(), 2);
        let step = of("step")[0];
        assert_eq!(
            (step["ph"].as_str(), step["ts"].as_f64(), step["dur"].as_f64()),
            (Some("X"), Some(0.0), Some(2.0))
        );
        let ends = of("in_flight");
        assert_eq!((ends[0]["ph"].as_str(), ends[1]["ph"].as_str()), (Some("b"), Some("e")));
        assert_eq!((ends[0]["id"].as_u64(), ends[1]["ts"].as_f64()), (ends[1]["id"].as_u64(), Some(10.0)));
        let infer = of("infer")[0];
        assert_eq!(
            (infer["pid"].as_u64(), infer["ts"].as_f64(), infer["args"]["n"].as_u64()),
            (Some(2), Some(2.0), Some(8))
        );
    }
}
