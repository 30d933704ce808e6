//! The device of a benchmark: `--device gpu|software`.

use anyhow::{Context, Result, bail};
use policy_host::nn::gpu::{AdapterKind, GpuDevice};

/// Usage of the option, for error messages.
pub const DEVICE_USAGE: &str = "--device gpu|software, ";

/// Choice of a device.
#[derive(Clone, Copy, Debug, Default)]
pub struct BenchDevice {
    /// Kind of device, or `None` for the CPU.
    pub kind: Option<AdapterKind>,
}

impl BenchDevice {
    /// Parses an option. Returns `Ok(false)` if it is another one.
    ///
    /// # Errors
    /// If the value is unknown.
    pub fn parse(&mut self, option: &str, value: &str) -> Result<bool> {
        match (option, value) {
            ("--device", "gpu") => self.kind = Some(AdapterKind::Hardware),
            ("--device", "software") => self.kind = Some(AdapterKind::Software),
            ("--device", _) => bail!("{option} is {value}, expected {}", DEVICE_USAGE.trim_end_matches(", ")),
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Opens the device.
    ///
    /// # Errors
    /// If no kind was chosen, or there is no such device.
    pub fn open(self) -> Result<GpuDevice> {
        Ok(policy_host::nn::gpu::open(self.kind.context("--device is missing")?, None)?)
    }
}
