//! The rules of `SHADING.md` make the same pictures on a CPU and on a device, and by both ways to visibility.

use sim::render::Samples;
use sim::render::{CpuRenderer, Renderer};

use crate::common::{Cells, VISIBILITIES, renderer, shots};

/// Codes by which most pixels may differ in any channel, and the share of pixels that must not differ by more.
const NEAR: u8 = 2;
const LEAST_NEAR: f64 = 0.995;
/// Codes by which few may, and the share of those that differ by more.
const FAR: u8 = 16;
const MOST_FAR: f64 = 0.002;

/// How two images differ.
#[derive(Clone, Copy, Debug)]
struct Difference {
    /// Share of the pixels that differ by no more than [`NEAR`].
    near: f64,
    /// Share that differ by more than [`FAR`].
    far: f64,
}

impl Difference {
    fn of(a: &[u8], b: &[u8]) -> Self {
        let pixels = a.chunks_exact(3).zip(b.chunks_exact(3));
        let apart = pixels.map(|(p, q)| p.iter().zip(q).map(|(x, y)| x.abs_diff(*y)).max().unwrap());
        let apart: Vec<u8> = apart.collect();
        let share =
            |is: &dyn Fn(u8) -> bool| apart.iter().filter(|d| is(**d)).count() as f64 / apart.len() as f64;
        Self { near: share(&|d| d <= NEAR), far: share(&|d| d > FAR) }
    }

    fn is_small(self) -> bool {
        self.near >= LEAST_NEAR && self.far <= MOST_FAR
    }
}

/// Fails with every image in which two renderers differ too much; says the worst.
fn assert_agree(what: &str, cells: Cells, shadows: bool, one: &mut dyn Renderer, other: &mut dyn Renderer) {
    let mut differences = Vec::new();
    for shot in shots(cells, shadows) {
        let pairs = shot.images(one).into_iter().zip(shot.images(other));
        let named = pairs
            .enumerate()
            .map(|(camera, (a, b))| (format!("{}, camera {camera}", shot.name), Difference::of(&a, &b)));
        differences.extend(named);
    }
    let least_near = differences.iter().map(|(_, d)| d.near).fold(1.0, f64::min);
    let most_far = differences.iter().map(|(_, d)| d.far).fold(0.0, f64::max);
    eprintln!("{what}: at worst {least_near:.4} near, {most_far:.4} far, of {} images", differences.len());
    differences.retain(|(_, difference)| !difference.is_small());
    assert!(differences.is_empty(), "{what}: {differences:#?}");
}

/// By both ways to visibility, without and with shadows.
fn assert_the_device_draws_what_the_cpu_draws(cells: Cells) {
    for visibility in VISIBILITIES {
        let Some(mut gpu) = renderer(visibility, Samples::One) else { return };
        for shadows in [false, true] {
            let what = format!("{}, shadows: {shadows}", gpu.name());
            assert_agree(&what, cells, shadows, &mut CpuRenderer::new(1), &mut gpu);
        }
    }
}

#[test]
fn the_device_draws_what_the_cpu_draws() {
    assert_the_device_draws_what_the_cpu_draws(Cells::OnePerTask);
}

#[test]
#[ignore = "takes minutes on a software driver; the test above draws every task, too"]
fn the_device_draws_what_the_cpu_draws_in_every_cell() {
    assert_the_device_draws_what_the_cpu_draws(Cells::All);
}

#[test]
fn both_ways_to_visibility_see_the_same() {
    for samples in [Samples::One, Samples::Four] {
        let [one, other] = VISIBILITIES.map(|visibility| renderer(visibility, samples));
        let (Some(mut one), Some(mut other)) = (one, other) else { return };
        assert_agree(
            &format!("raster and compute, {samples:?}"),
            Cells::OnePerTask,
            true,
            &mut one,
            &mut other,
        );
    }
}
