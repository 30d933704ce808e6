//! The machine that a run is executed on, as results name it.

use std::fmt;

use policy_host::nn::gemm::peak::try_peak_gflop_per_s;
use run_config::allotment::n_cores;
use serde::Serialize;

/// The facts about a machine that timings depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Machine {
    /// Name of the machine, or of the node that the batch system sees in it.
    pub(crate) host: String,
    /// Model name of the CPU.
    pub(crate) cpu: String,
    /// Extensions of the instruction set of which kernels have their own versions.
    pub(crate) vector_extensions: Vec<&'static str>,
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
            host: host_name(),
            vector_extensions: vector_extensions(),
            cpu: cpu_model().unwrap_or_else(|| "unknown".to_owned()),
            n_cores: n_cores(),
            os: format!("{} {} {}", part(name.sysname()), part(name.release()), part(name.machine())),
        }
    }

    /// Returns `true` if 8-bit inference is faster than f32.
    pub(crate) fn is_fast_in_int8(&self) -> bool {
        self.vector_extensions.contains(&"avx512vnni")
    }
}

impl fmt::Display for Machine {
    /// Writes what may make a difference to floating-point numbers.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { host, cpu, vector_extensions, .. } = self;
        write!(f, "{host} ({cpu}; {})", vector_extensions.join(" "))
    }
}

/// The cores of a machine, what they could compute, and how many a process of the fleet uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cores {
    /// Number of cores this process may use.
    pub(crate) count: u32,
    /// Number of worker threads of the sim and of each policy host.
    pub(crate) n_threads: u32,
    /// Peak of a core in f32 while all are busy, on registers only, in GFLOP/s; `None` if not measured.
    pub(crate) peak_gflop: Option<f64>,
}

impl Cores {
    /// Counts the cores, and measures their peak if that is wanted (0.07 s).
    pub(crate) fn measure(machine: &Machine, n_threads: u32, with_peak: bool) -> Self {
        let count = machine.n_cores;
        let peak = || try_peak_gflop_per_s(count as usize).ok();
        let peak = if with_peak { peak() } else { None };
        Self { count, n_threads, peak_gflop: peak.map(|peak| peak / f64::from(count)) }
    }
}

/// Returns the name of the machine. Several nodes of Slurm may be on one machine.
pub(crate) fn host_name() -> String {
    let node = std::env::var("SLURMD_NODENAME").ok().filter(|name| !name.is_empty());
    node.unwrap_or_else(|| rustix::system::uname().nodename().to_string_lossy().into_owned())
}

fn vector_extensions() -> Vec<&'static str> {
    #[cfg(target_arch = "x86_64")]
    let detected = [
        ("fma", std::arch::is_x86_feature_detected!("fma")),
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
        ("avx512vnni", std::arch::is_x86_feature_detected!("avx512vnni")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let detected: [(&str, bool); 0] = [];
    detected.into_iter().filter(|(_, is_there)| *is_there).map(|(name, _)| name).collect()
}

fn cpu_model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, model)| model.trim().to_owned())
}
