//! The Vulkan adapters of this machine, in the order in which they are numbered.

use core::fmt;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

/// Kind of Vulkan adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceKind {
    /// A physical or virtual GPU.
    Hardware,
    /// A software driver that runs on the CPU, for tests: Mesa's lavapipe.
    Software,
}

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

impl DeviceKind {
    pub(crate) const fn description(self) -> &'static str {
        match self {
            Self::Hardware => "GPU",
            Self::Software => "software Vulkan driver",
        }
    }

    pub(crate) const fn matches(self, device_type: wgpu::DeviceType) -> bool {
        use wgpu::DeviceType::{DiscreteGpu, IntegratedGpu, VirtualGpu};
        let is_hardware = matches!(device_type, DiscreteGpu | IntegratedGpu | VirtualGpu);
        is_hardware == matches!(self, Self::Hardware)
    }
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

/// Returns the result of a future that is ready immediately, as all futures of wgpu are outside of a browser.
pub(crate) fn poll_ready<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => unreachable!("native wgpu futures are ready immediately"),
    }
}
