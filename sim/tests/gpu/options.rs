//! Renderer options and adapter selection.

use ipc_types::{ImageSize, ImageSizes};
use sim::render::gpu::AdapterKind;
use sim::render::{GpuRenderer, OpenRendererError, RendererChoice, Samples, open};

use crate::common::{PerturbationSet, adapter_kind, renderer, test_scenes};

#[test]
#[ignore = "needs a Vulkan driver"]
fn four_samples_change_only_edges() {
    let [mut one, mut four] =
        [Samples::One, Samples::Four].map(|samples| renderer(samples, ImageSizes::BENCHMARK));
    for scene in test_scenes(PerturbationSet::OnePerTask, true, ImageSizes::BENCHMARK) {
        for (camera, (a, b)) in scene.images(&mut one).iter().zip(scene.images(&mut four)).enumerate() {
            let differs = |p: &[u8], q: &[u8]| p.iter().zip(q).any(|(x, y)| x.abs_diff(*y) > 2);
            let n_changed = a.chunks_exact(3).zip(b.chunks_exact(3)).filter(|(p, q)| differs(p, q)).count();
            let fraction = n_changed as f64 / (a.len() / 3) as f64;
            assert!((0.002..0.15).contains(&fraction), "{}, camera {camera}: {fraction}", scene.name);
        }
    }
}

#[test]
fn auto_opens_an_available_renderer() {
    let name = open(RendererChoice::Auto, None, Samples::One, ImageSizes::BENCHMARK, 1).unwrap().name();
    assert!(name.starts_with("cpu") || name.starts_with("gpu"), "{name}");
    let cpu = open(RendererChoice::Cpu, None, Samples::One, ImageSizes::BENCHMARK, 1).unwrap();
    assert!(cpu.name().starts_with("cpu"));
}

#[test]
fn missing_gpu_error_lists_adapters_found() {
    let opened = GpuRenderer::open(AdapterKind::Hardware, Some(99), Samples::One, ImageSizes::BENCHMARK);
    let error = opened.map(|_| ()).unwrap_err();
    let OpenRendererError::NoAdapter { found, .. } = &error else { panic!("{error}") };
    assert!(!found.is_empty() && error.to_string().contains("--renderer cpu"), "{error}");
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn oversized_images_are_refused_with_their_size() {
    let external = ImageSize::square(1 << 16);
    let sizes = ImageSizes { external, ..ImageSizes::BENCHMARK };
    let error = GpuRenderer::open(adapter_kind(), None, Samples::One, sizes).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("65536x65536,wrist=128x128, need a buffer of 65"), "{error}");
}
