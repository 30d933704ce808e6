//! What may be chosen.

use sim::render::gpu::{AdapterKind, GpuOptions};
use sim::render::{GpuRenderer, OpenRendererError, RendererChoice, Samples, open};

use crate::common::{Cells, VISIBILITIES, renderer, shots};

#[test]
fn four_samples_smooth_edges_and_leave_the_rest() {
    for visibility in VISIBILITIES {
        let (Some(mut one), Some(mut four)) =
            (renderer(visibility, Samples::One), renderer(visibility, Samples::Four))
        else {
            return;
        };
        for shot in shots(Cells::OnePerTask, true) {
            for (camera, (a, b)) in shot.images(&mut one).iter().zip(shot.images(&mut four)).enumerate() {
                let apart = |p: &[u8], q: &[u8]| p.iter().zip(q).any(|(x, y)| x.abs_diff(*y) > 2);
                let n_changed = a.chunks_exact(3).zip(b.chunks_exact(3)).filter(|(p, q)| apart(p, q)).count();
                let share = n_changed as f64 / (a.len() / 3) as f64;
                assert!((0.002..0.15).contains(&share), "{}, camera {camera}: {share}", shot.name);
            }
        }
    }
}

#[test]
fn auto_draws_whatever_the_machine_has() {
    let name = open(RendererChoice::Auto, Samples::One, 1).unwrap().name();
    assert!(name.starts_with("cpu") || name.starts_with("gpu"), "{name}");
    assert!(open(RendererChoice::Cpu, Samples::One, 1).unwrap().name().starts_with("cpu"));
}

#[test]
fn a_gpu_that_is_missing_is_missed_by_what_was_found() {
    if let Err(error) = GpuRenderer::open(AdapterKind::Hardware, &GpuOptions::default()) {
        let OpenRendererError::NoAdapter { found, .. } = &error else { panic!("{error}") };
        assert!(!found.is_empty() && error.to_string().contains("--renderer cpu"), "{error}");
    }
}
