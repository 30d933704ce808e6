//! The Vulkan adapters of this machine, in the order in which they are numbered.

use core::fmt;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

/// Kind of Vulkan adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// A physical or virtual GPU.
    Hardware,
    /// A software driver that runs on the CPU, for tests: Mesa's lavapipe.
    Software,
}

/// An adapter and how it is chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterSummary {
    /// Name of the adapter and its driver.
    pub name: String,
    /// Kind of the adapter.
    pub kind: AdapterKind,
    /// Index among the adapters of its kind, discrete GPUs before integrated ones.
    pub index: usize,
    /// Size of the largest buffer that a kernel can use, in bytes.
    pub max_buffer_bytes: u64,
}

impl AdapterKind {
    pub(crate) const fn description(self) -> &'static str {
        match self {
            Self::Hardware => "GPU",
            Self::Software => "software Vulkan driver",
        }
    }

    const fn of(device_type: wgpu::DeviceType) -> Self {
        use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};
        match device_type {
            DiscreteGpu | IntegratedGpu | VirtualGpu => Self::Hardware,
            Cpu | Other => Self::Software,
        }
    }
}

impl fmt::Display for AdapterSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.kind == AdapterKind::Hardware { "gpu" } else { "software" };
        let (index, name, max_mib) = (self.index, &self.name, self.max_buffer_bytes >> 20);
        write!(f, "{kind} {index}: {name}, buffers up to {max_mib} MiB")
    }
}

/// Lists all adapters.
#[must_use]
pub fn adapters() -> Vec<AdapterSummary> {
    numbered().into_iter().map(|(_, summary)| summary).collect()
}

/// Returns all adapters, discrete GPUs first.
pub(crate) fn numbered() -> Vec<(wgpu::Adapter, AdapterSummary)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut adapters = poll_ready(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    adapters.sort_by_key(|adapter| adapter.get_info().device_type != wgpu::DeviceType::DiscreteGpu);
    let mut counts = [0; 2];
    let summarise = |adapter: wgpu::Adapter| {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let kind = AdapterKind::of(info.device_type);
        counts[kind as usize] += 1;
        let summary = AdapterSummary {
            name: format!("{} ({})", info.name, format!("{} {}", info.driver, info.driver_info).trim()),
            kind,
            index: counts[kind as usize] - 1,
            max_buffer_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
        };
        (adapter, summary)
    };
    adapters.into_iter().map(summarise).collect()
}

/// Returns the result of a future that is ready immediately, as all futures of wgpu are outside of a browser.
pub(crate) fn poll_ready<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => unreachable!("native wgpu futures are ready immediately"),
    }
}
