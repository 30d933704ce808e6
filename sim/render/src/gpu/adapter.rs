//! Adapter selection, and the features and limits that an adapter must have.

use core::pin::pin;
use core::task::{Context, Poll, Waker};

use super::options::{GpuOptions, VisibilityMethod};
use crate::renderer::OpenRendererError;

/// Kind of Vulkan adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// A physical or virtual GPU.
    Hardware,
    /// A software driver that runs on the CPU, for tests: Mesa's lavapipe.
    Software,
}

/// NVIDIA data-centre GPUs. They have few rasterisation units relative to their compute throughput.
const COMPUTE_GPUS: [&str; 8] = ["A100", "A800", "H100", "H200", "H800", "B100", "B200", "B300"];

/// An adapter that meets all requirements.
pub(crate) struct SelectedAdapter {
    pub(crate) adapter: wgpu::Adapter,
    pub(crate) visibility: VisibilityMethod,
    /// Name of the adapter and its driver, for messages.
    pub(crate) name: String,
}

/// Selects an adapter by kind and index.
///
/// # Errors
/// If there is none, or it does not meet all requirements. The error lists the adapters found and the
/// capabilities that each lacks.
pub(crate) fn select(kind: AdapterKind, options: &GpuOptions) -> Result<SelectedAdapter, OpenRendererError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let (mut rejections, mut n_before) = (Vec::new(), 0);
    let mut adapters = poll_ready(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    // Prefer discrete GPUs over integrated ones.
    adapters.sort_by_key(|adapter| adapter.get_info().device_type != wgpu::DeviceType::DiscreteGpu);
    for adapter in adapters {
        let info = adapter.get_info();
        let name = format!("{} ({})", info.name, [info.driver, info.driver_info].join(" ").trim());
        if kind_of(info.device_type) != kind {
            rejections.push(format!("{name} is not a {}", kind.description()));
            continue;
        }
        n_before += 1;
        if options.index.is_some_and(|index| index != n_before - 1) {
            rejections.push(format!("{name} has index {}", n_before - 1));
            continue;
        }
        let visibility = options.visibility.unwrap_or_else(|| preferred_visibility(&adapter, &info.name));
        let missing = missing_capabilities(&adapter, visibility);
        if missing.is_empty() {
            return Ok(SelectedAdapter { adapter, visibility, name });
        }
        rejections.push(format!("{name} lacks {}", missing.join(", ")));
    }
    if rejections.is_empty() {
        rejections.push("there is no Vulkan driver".to_owned());
    }
    let index = options.index.map(|index| format!(" {index}")).unwrap_or_default();
    let wanted = format!("{}{index}", kind.description());
    Err(OpenRendererError::NoAdapter { wanted, found: rejections.join("; ") })
}

/// Returns the features and limits that a visibility method requires.
pub(crate) fn required(visibility: VisibilityMethod) -> (wgpu::Features, wgpu::Limits) {
    let features = match visibility {
        VisibilityMethod::Raster => wgpu::Features::PRIMITIVE_INDEX | wgpu::Features::INDIRECT_FIRST_INSTANCE,
        VisibilityMethod::Compute => {
            wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX
        }
    };
    (features, wgpu::Limits::defaults())
}

impl AdapterKind {
    const fn description(self) -> &'static str {
        match self {
            Self::Hardware => "GPU",
            Self::Software => "software driver",
        }
    }
}

fn kind_of(device_type: wgpu::DeviceType) -> AdapterKind {
    use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other, VirtualGpu};
    match device_type {
        DiscreteGpu | IntegratedGpu | VirtualGpu => AdapterKind::Hardware,
        Cpu | Other => AdapterKind::Software,
    }
}

/// Returns compute for [`COMPUTE_GPUS`] and the rasteriser for all others, or the other method if the adapter
/// supports only that one.
fn preferred_visibility(adapter: &wgpu::Adapter, name: &str) -> VisibilityMethod {
    let prefers_compute = COMPUTE_GPUS.iter().any(|gpu| name.contains(gpu));
    let [first, second] = if prefers_compute {
        [VisibilityMethod::Compute, VisibilityMethod::Raster]
    } else {
        [VisibilityMethod::Raster, VisibilityMethod::Compute]
    };
    if missing_capabilities(adapter, first).is_empty() || !missing_capabilities(adapter, second).is_empty() {
        first
    } else {
        second
    }
}

/// Lists the required features and limits that an adapter lacks.
fn missing_capabilities(adapter: &wgpu::Adapter, visibility: VisibilityMethod) -> Vec<String> {
    let (features, limits) = required(visibility);
    let missing_features = features - adapter.features();
    let mut missing: Vec<String> = missing_features.iter_names().map(|(name, _)| name.to_owned()).collect();
    limits.check_limits_with_fail_fn(&adapter.limits(), false, |name, required, available| {
        missing.push(format!("{name} {required} (available: {available})"));
    });
    missing
}

/// Returns the result of a future that is ready immediately, as all futures of wgpu are outside of a browser.
pub(crate) fn poll_ready<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => unreachable!("native wgpu futures are ready immediately"),
    }
}
