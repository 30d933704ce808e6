//! The Vulkan adapters of this machine, in the order in which they are numbered.

use core::fmt;

use super::device::{DeviceKind, poll_ready};

/// An adapter and what matters for policies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterSummary {
    /// Name of the adapter and its driver.
    pub name: String,
    /// Kind of the adapter, and its index among those of this kind.
    pub number: Option<(DeviceKind, usize)>,
    /// Size of the largest buffer that a kernel can use, in bytes.
    pub max_binding: u64,
}

/// Lists all adapters.
#[must_use]
pub fn adapters() -> Vec<AdapterSummary> {
    let mut counts = [0; 2];
    let summarise = |adapter: wgpu::Adapter| {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let kinds = [DeviceKind::Hardware, DeviceKind::Software];
        let number = kinds.into_iter().zip(&mut counts).find(|(kind, _)| kind.matches(info.device_type));
        let number = number.map(|(kind, count)| {
            *count += 1;
            (kind, *count - 1)
        });
        AdapterSummary {
            name: name(&info),
            number,
            max_binding: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
        }
    };
    enumerate().into_iter().map(summarise).collect()
}

/// Returns all adapters, discrete GPUs first.
pub(crate) fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut adapters = poll_ready(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    adapters.sort_by_key(|adapter| adapter.get_info().device_type != wgpu::DeviceType::DiscreteGpu);
    adapters
}

/// Returns the name of an adapter and its driver.
pub(crate) fn name(info: &wgpu::AdapterInfo) -> String {
    format!("{} ({})", info.name, format!("{} {}", info.driver, info.driver_info).trim())
}

impl fmt::Display for AdapterSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((kind, index)) = self.number {
            let kind = if kind == DeviceKind::Hardware { "gpu" } else { "software" };
            write!(f, "{kind} {index}: ")?;
        }
        write!(f, "{}, buffers up to {} MiB", self.name, self.max_binding >> 20)
    }
}
