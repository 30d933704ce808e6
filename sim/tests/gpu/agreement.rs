//! Agreement of images between the CPU and GPU renderers.

use ipc_types::ImageSizes;
use sim::render::gpu::AdapterKind;
use sim::render::{CpuOptions, CpuRenderer, Renderer, Samples};

use crate::common::{PerturbationSet, adapter_kind, renderer, test_scenes};

/// Deviation in sRGB codes that most pixels must not exceed in any channel.
const NEAR: u8 = 2;
/// Deviation in sRGB codes that only few pixels may exceed.
const FAR: u8 = 16;

/// Deviation between two images.
#[derive(Clone, Copy, Debug)]
struct ImageDeviation {
    /// Fraction of pixels that deviate by at most [`NEAR`].
    near: f64,
    /// Fraction of pixels that deviate by more than [`FAR`].
    far: f64,
}

impl ImageDeviation {
    fn between(a: &[u8], b: &[u8]) -> Self {
        let pixels = a.chunks_exact(3).zip(b.chunks_exact(3));
        let deviations = pixels.map(|(p, q)| p.iter().zip(q).map(|(x, y)| x.abs_diff(*y)).max().unwrap());
        let deviations: Vec<u8> = deviations.collect();
        let fraction = |predicate: &dyn Fn(u8) -> bool| {
            deviations.iter().filter(|d| predicate(**d)).count() as f64 / deviations.len() as f64
        };
        Self { near: fraction(&|d| d <= NEAR), far: fraction(&|d| d > FAR) }
    }

    /// Returns `true` if few pixels deviate. With four samples they do at edges, where the CPU lights the
    /// point at the depth of a sample.
    fn is_small(self, samples: Samples) -> bool {
        let (min_near, max_far) = match samples {
            Samples::One => (0.995, 0.002),
            Samples::Four => (0.965, 0.006),
        };
        self.near >= min_near && self.far <= max_far
    }
}

/// Asserts that GPU and CPU agree in all images, and prints the worst deviation.
fn assert_gpu_matches_cpu(set: PerturbationSet, samples: Samples, shadows: bool, sizes: ImageSizes) {
    let mut gpu = renderer(samples, sizes);
    let mut cpu = CpuRenderer::with_options(1, CpuOptions { samples, ..CpuOptions::default() });
    let label = format!("{}, {sizes}, shadows: {shadows}", gpu.name());
    let mut deviations = Vec::new();
    for scene in test_scenes(set, shadows, sizes) {
        let pairs = scene.images(&mut cpu).into_iter().zip(scene.images(&mut gpu));
        let named = pairs.enumerate().map(|(camera, (a, b))| {
            (format!("{}, camera {camera}", scene.name), ImageDeviation::between(&a, &b))
        });
        deviations.extend(named);
    }
    let min_near = deviations.iter().map(|(_, d)| d.near).fold(1.0, f64::min);
    let max_far = deviations.iter().map(|(_, d)| d.far).fold(0.0, f64::max);
    eprintln!(
        "{label}: at least {min_near:.4} near, at most {max_far:.4} far in {} images",
        deviations.len()
    );
    deviations.retain(|(_, deviation)| !deviation.is_small(samples));
    assert!(deviations.is_empty(), "{label}: {deviations:#?}");
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn gpu_matches_cpu_for_every_task() {
    // All perturbations take minutes on a software driver.
    let set = match adapter_kind() {
        AdapterKind::Software => PerturbationSet::OnePerTask,
        AdapterKind::Hardware => PerturbationSet::All,
    };
    assert_gpu_matches_cpu(set, Samples::One, false, ImageSizes::BENCHMARK);
    assert_gpu_matches_cpu(set, Samples::One, true, ImageSizes::BENCHMARK);
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn gpu_matches_cpu_with_four_samples() {
    assert_gpu_matches_cpu(PerturbationSet::OnePerTask, Samples::Four, true, ImageSizes::BENCHMARK);
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn gpu_matches_cpu_at_other_sizes() {
    // With four samples the smallest images consist of edges.
    for (samples, sizes) in [
        (Samples::One, "640x480,wrist=99x65"),
        (Samples::One, "64x64,wrist=250x250"),
        (Samples::One, "1280x960,wrist=65x64"),
        (Samples::Four, "640x480,wrist=250x249"),
        (Samples::Four, "1280x960,wrist=131x129"),
    ] {
        assert_gpu_matches_cpu(PerturbationSet::FewTasks, samples, true, sizes.parse().unwrap());
    }
}
