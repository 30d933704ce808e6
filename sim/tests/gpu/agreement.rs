//! Agreement of images between the CPU and GPU renderers, and between both visibility methods.

use sim::render::Samples;
use sim::render::{CpuRenderer, Renderer};

use crate::common::{PerturbationSet, VISIBILITIES, renderer, test_scenes};

/// Deviation in sRGB codes that most pixels must not exceed in any channel.
const NEAR: u8 = 2;
/// Minimum fraction of pixels that deviate by at most [`NEAR`].
const MIN_NEAR: f64 = 0.995;
/// Deviation in sRGB codes that only few pixels may exceed.
const FAR: u8 = 16;
/// Maximum fraction of pixels that deviate by more than [`FAR`].
const MAX_FAR: f64 = 0.002;

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

    fn is_small(self) -> bool {
        self.near >= MIN_NEAR && self.far <= MAX_FAR
    }
}

/// Asserts that two renderers agree in all images, and prints the worst deviation.
fn assert_agree(
    label: &str,
    set: PerturbationSet,
    shadows: bool,
    one: &mut dyn Renderer,
    other: &mut dyn Renderer,
) {
    let mut deviations = Vec::new();
    for scene in test_scenes(set, shadows) {
        let pairs = scene.images(one).into_iter().zip(scene.images(other));
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
    deviations.retain(|(_, deviation)| !deviation.is_small());
    assert!(deviations.is_empty(), "{label}: {deviations:#?}");
}

/// Asserts agreement for both visibility methods, without and with shadows.
fn assert_gpu_matches_cpu(set: PerturbationSet) {
    for visibility in VISIBILITIES {
        let Some(mut gpu) = renderer(visibility, Samples::One) else { return };
        for shadows in [false, true] {
            let label = format!("{}, shadows: {shadows}", gpu.name());
            assert_agree(&label, set, shadows, &mut CpuRenderer::new(1), &mut gpu);
        }
    }
}

#[test]
fn gpu_matches_cpu_for_every_task() {
    assert_gpu_matches_cpu(PerturbationSet::OnePerTask);
}

#[test]
#[ignore = "takes minutes on a software driver; the test above covers every task, too"]
fn gpu_matches_cpu_for_every_perturbation() {
    assert_gpu_matches_cpu(PerturbationSet::All);
}

#[test]
fn visibility_methods_agree() {
    for samples in [Samples::One, Samples::Four] {
        let [one, other] = VISIBILITIES.map(|visibility| renderer(visibility, samples));
        let (Some(mut one), Some(mut other)) = (one, other) else { return };
        assert_agree(
            &format!("raster and compute, {samples:?}"),
            PerturbationSet::OnePerTask,
            true,
            &mut one,
            &mut other,
        );
    }
}
