//! The device of a benchmark: `--device gpu|software` and `--products chains|matrices`.

use anyhow::{Context, Result, bail};
use policy_host::nn::gpu::{DeviceKind, GpuDevice, GpuError, ProductMethod};

/// Usage of the options, for error messages.
pub const DEVICE_USAGE: &str = "--device gpu|software, --products chains|matrices, ";

/// Choice of a device and of its products.
#[derive(Clone, Copy, Debug, Default)]
pub struct BenchDevice {
    /// Kind of device, or `None` for the CPU.
    pub kind: Option<DeviceKind>,
    products: ProductMethod,
}

impl BenchDevice {
    /// Parses an option. Returns `Ok(false)` if it is another one.
    ///
    /// # Errors
    /// If the value is unknown.
    pub fn parse(&mut self, option: &str, value: &str) -> Result<bool> {
        match (option, value) {
            ("--device", "gpu") => self.kind = Some(DeviceKind::Hardware),
            ("--device", "software") => self.kind = Some(DeviceKind::Software),
            ("--products", "chains") => self.products = ProductMethod::Chains,
            ("--products", "matrices") => self.products = ProductMethod::SplitMatrices,
            ("--device" | "--products", _) => {
                bail!("{option} is {value}, expected {}", DEVICE_USAGE.trim_end_matches(", "))
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Opens the device. Returns `None`, and prints why, if it has no matrices for its products, so that
    /// there is nothing to measure.
    ///
    /// # Errors
    /// If no kind was chosen, or there is no such device.
    #[expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]
    pub fn open(self) -> Result<Option<GpuDevice>> {
        let kind = self.kind.context("--device is missing")?;
        match GpuDevice::open_with(kind, 0, self.products) {
            Ok(gpu) => Ok(Some(gpu)),
            Err(error @ GpuError::NoMatrices { .. }) => {
                println!("nothing to measure: {error}");
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }
}
