//! The machine that a run is executed on, as results name it.

use std::thread::available_parallelism;

use serde::Serialize;

/// The facts about a machine that timings depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Machine {
    /// Model name of the CPU.
    pub(crate) cpu: String,
    /// Number of cores this process may use.
    pub(crate) n_cores: u32,
    /// Kernel name, release and architecture.
    pub(crate) os: String,
}

impl Machine {
    /// Detects the machine that this process runs on.
    pub(crate) fn detect() -> Self {
        let name = rustix::system::uname();
        let part = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
        Self {
            cpu: cpu_model().unwrap_or_else(|| "unknown".to_owned()),
            n_cores: available_parallelism().map_or(1, |n| n.get().try_into().unwrap_or(u32::MAX)),
            os: format!("{} {} {}", part(name.sysname()), part(name.release()), part(name.machine())),
        }
    }
}

fn cpu_model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, model)| model.trim().to_owned())
}
