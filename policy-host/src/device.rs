//! The device on which the policies of a run compute.

use run_config::{DeviceChoice, RunConfig};
use thiserror::Error;

use crate::nn::Precision;
use crate::spec::PolicySpec;

/// A request for a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceRequest {
    /// Kind of device.
    pub choice: DeviceChoice,
    /// Index among the GPUs, or the software drivers; the first by default.
    pub index: Option<u32>,
}

impl From<DeviceChoice> for DeviceRequest {
    fn from(choice: DeviceChoice) -> Self {
        Self { choice, index: None }
    }
}

impl From<&RunConfig> for DeviceRequest {
    fn from(config: &RunConfig) -> Self {
        Self { choice: config.inference.policy_device, index: config.resources.gpu }
    }
}

/// A device that has been found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundDevice {
    /// The choice that opens it; never [`DeviceChoice::Auto`].
    pub choice: DeviceChoice,
    /// Kind, adapter and driver. Actions of devices that differ in this may differ in single bits. `None` for
    /// the CPU, whose bits are the same everywhere.
    pub identity: Option<String>,
}

/// Errors that can occur while looking for a device.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum DeviceError {
    #[error("policy `{spec}` computes on the CPU only; use --policy-device cpu or auto")]
    Unsupported { spec: PolicySpec },
    #[error("{reason}; use --policy-device cpu or auto, or install a driver")]
    Unusable { reason: String },
    #[error("{reason}; use --policy-device cpu")]
    Failed { reason: String },
    #[error(
        "this program was built without policies on a GPU; build it with `--features gpu`, or use --policy-device cpu or auto"
    )]
    NotBuilt,
}

#[cfg(feature = "gpu")]
impl DeviceRequest {
    /// Returns kind and index of the adapter to open.
    pub(crate) fn adapter(self) -> (crate::nn::gpu::AdapterKind, Option<usize>) {
        use crate::nn::gpu::AdapterKind;
        let kind = match self.choice {
            DeviceChoice::Software => AdapterKind::Software,
            _ => AdapterKind::Hardware,
        };
        (kind, self.index.map(|index| index as usize))
    }
}

impl FoundDevice {
    const CPU: Self = Self { choice: DeviceChoice::Cpu, identity: None };
}

/// Returns `true` if this policy can compute on a GPU.
#[must_use]
pub fn supports_gpu(spec: &PolicySpec) -> bool {
    matches!(spec, PolicySpec::Network(_, source) if source.precision == Precision::F32)
}

/// Finds the device for these policies. `Auto` selects the CPU if no policy can use a GPU, or none is usable
/// and none was asked for by its index.
///
/// # Errors
/// If `choice` requires a GPU or a software driver that cannot be opened, or a network of another kind.
pub fn find(specs: &[&PolicySpec], request: DeviceRequest) -> Result<FoundDevice, DeviceError> {
    let is_cpu_only = |spec: &&&PolicySpec| matches!(spec, PolicySpec::Network(..)) && !supports_gpu(spec);
    match request.choice {
        DeviceChoice::Cpu => return Ok(FoundDevice::CPU),
        DeviceChoice::Auto => {}
        DeviceChoice::Gpu | DeviceChoice::Software => {
            if let Some(spec) = specs.iter().find(is_cpu_only) {
                return Err(DeviceError::Unsupported { spec: (*spec).clone() });
            }
        }
    }
    if !specs.iter().any(|spec| supports_gpu(spec)) {
        return Ok(FoundDevice::CPU);
    }
    match (open(request), request) {
        (Err(_), DeviceRequest { choice: DeviceChoice::Auto, index: None }) => Ok(FoundDevice::CPU),
        (found, _) => found,
    }
}

/// Opens a device and closes it again.
#[cfg(feature = "gpu")]
fn open(request: DeviceRequest) -> Result<FoundDevice, DeviceError> {
    use crate::nn::gpu::AdapterKind;
    let (kind, index) = request.adapter();
    let (choice, prefix) = match kind {
        AdapterKind::Software => (DeviceChoice::Software, SOFTWARE),
        AdapterKind::Hardware => (DeviceChoice::Gpu, "gpu: "),
    };
    let gpu = crate::nn::gpu::open(kind, index)
        .map_err(|error| DeviceError::Unusable { reason: error.to_string() })?;
    Ok(FoundDevice { choice, identity: Some(format!("{prefix}{}", gpu.name())) })
}

#[cfg(not(feature = "gpu"))]
fn open(_: DeviceRequest) -> Result<FoundDevice, DeviceError> {
    Err(DeviceError::NotBuilt)
}

/// Start of the identity of a software driver.
const SOFTWARE: &str = "software: ";

/// Returns the request that opens a device with this identity, if this machine has it.
#[must_use]
pub fn request_of(identity: Option<&str>) -> DeviceRequest {
    let choice = match identity {
        None => DeviceChoice::Cpu,
        Some(identity) if identity.starts_with(SOFTWARE) => DeviceChoice::Software,
        Some(_) => DeviceChoice::Gpu,
    };
    // The first adapter is the default, for which the renderer may fall back to the CPU.
    DeviceRequest { choice, index: identity.and_then(index_of).filter(|index| *index > 0) }
}

/// Returns the index of the adapter with this identity among those of its kind.
#[cfg(feature = "gpu")]
fn index_of(identity: &str) -> Option<u32> {
    let adapters = crate::nn::gpu::adapters();
    let same =
        adapters.iter().find(|adapter| identity.split_once(": ").is_some_and(|it| it.1 == adapter.name));
    same.map(|adapter| adapter.index as u32)
}

#[cfg(not(feature = "gpu"))]
fn index_of(_: &str) -> Option<u32> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(specs: &[&str], choice: DeviceChoice) -> Result<FoundDevice, DeviceError> {
        let specs: Vec<PolicySpec> = specs.iter().map(|spec| spec.parse().unwrap()).collect();
        find(&specs.iter().collect::<Vec<_>>(), choice.into())
    }

    #[test]
    fn policies_without_networks_use_the_cpu() {
        for choice in [DeviceChoice::Auto, DeviceChoice::Cpu, DeviceChoice::Gpu, DeviceChoice::Software] {
            assert_eq!(found(&["idle", "expert", "attach:x"], choice), Ok(FoundDevice::CPU));
        }
        assert_eq!(found(&["act:x", "pi05:y"], DeviceChoice::Cpu), Ok(FoundDevice::CPU));
    }

    #[test]
    fn networks_for_the_cpu_are_named() {
        for spec in ["act-int8:x", "pi05-int8:x"] {
            let error = found(&["act:y", spec], DeviceChoice::Software).unwrap_err().to_string();
            assert!(error.contains(spec) && error.contains("--policy-device cpu"), "{error}");
        }
    }
}
