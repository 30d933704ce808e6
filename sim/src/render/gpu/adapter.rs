//! Which adapter draws, and what one must have.

use super::ready;
use super::{GpuOptions, Visibility};
use crate::render::open::OpenRendererError;

/// Where to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// A GPU.
    Hardware,
    /// A driver that runs on the CPU, for tests: Mesa's lavapipe.
    Software,
}

/// NVIDIA's chips for data centres: nearly all of such a chip can compute, a small part of it rasterises.
const COMPUTE_CHIPS: [&str; 8] = ["A100", "A800", "H100", "H200", "H800", "B100", "B200", "B300"];

/// An adapter that has what it takes.
pub(super) struct Found {
    pub(super) adapter: wgpu::Adapter,
    pub(super) visibility: Visibility,
    /// Name of adapter and driver, for people.
    pub(super) name: String,
}

/// The first adapter of a kind that can do what is asked.
///
/// # Errors
/// If there is none: what was found, and what each lacks.
pub(super) fn find(kind: AdapterKind, options: &GpuOptions) -> Result<Found, OpenRendererError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut complaints = Vec::new();
    let mut adapters = ready(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    // A card before what is built into a processor.
    adapters.sort_by_key(|adapter| adapter.get_info().device_type != wgpu::DeviceType::DiscreteGpu);
    for adapter in adapters {
        let info = adapter.get_info();
        let name = format!("{} ({})", info.name, [info.driver, info.driver_info].join(" ").trim());
        if kind_of(info.device_type) != kind {
            complaints.push(format!("{name} is no {}", kind.described()));
            continue;
        }
        let visibility = options.visibility.unwrap_or_else(|| best(&adapter, &info.name));
        let lacks = lacks(&adapter, visibility);
        if lacks.is_empty() {
            return Ok(Found { adapter, visibility, name });
        }
        complaints.push(format!("{name} lacks {}", lacks.join(", ")));
    }
    if complaints.is_empty() {
        complaints.push("there is no Vulkan driver".to_owned());
    }
    Err(OpenRendererError::NoAdapter { wanted: kind.described(), found: complaints.join("; ") })
}

/// What is asked of a device.
pub(super) fn required(visibility: Visibility) -> (wgpu::Features, wgpu::Limits) {
    let features = match visibility {
        Visibility::Raster => wgpu::Features::PRIMITIVE_INDEX,
        Visibility::Compute => wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX,
    };
    (features, wgpu::Limits::defaults())
}

impl AdapterKind {
    const fn described(self) -> &'static str {
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

/// Compute on chips made for it, else the rasteriser, unless only the other is there.
fn best(adapter: &wgpu::Adapter, name: &str) -> Visibility {
    let computes = COMPUTE_CHIPS.iter().any(|chip| name.contains(chip));
    let [first, second] = if computes {
        [Visibility::Compute, Visibility::Raster]
    } else {
        [Visibility::Raster, Visibility::Compute]
    };
    if lacks(adapter, first).is_empty() || !lacks(adapter, second).is_empty() { first } else { second }
}

/// Names of the features and limits that an adapter does not reach.
fn lacks(adapter: &wgpu::Adapter, visibility: Visibility) -> Vec<String> {
    let (features, limits) = required(visibility);
    let missing = features - adapter.features();
    let mut lacks: Vec<String> = missing.iter_names().map(|(name, _)| name.to_owned()).collect();
    limits.check_limits_with_fail_fn(&adapter.limits(), false, |name, needed, there| {
        lacks.push(format!("{name} {needed} (it has {there})"));
    });
    lacks
}
