//! Properties that hold for every texture.

use super::{PITCH, SIDE, image};
use scene::Texture::{self, *};

const GRADIENTS: [Texture; 4] = [Sunset, Ocean, Glow, Rainbow];

/// Returns the linear factors of the texels of a tile, in row-major order.
fn factors(texture: Texture) -> Vec<[f64; 3]> {
    let linear = |i: usize| {
        let [r, g, b, alpha] = image(texture).texels[i / SIDE * PITCH + i % SIDE].to_le_bytes();
        assert_eq!(alpha, 255);
        [r, g, b].map(|code| (f64::from(code) / 255.0) * (f64::from(code) / 255.0))
    };
    (0..SIDE * SIDE).map(linear).collect()
}

fn difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f64>() / 3.0
}

fn mean(values: &[[f64; 3]]) -> [f64; 3] {
    core::array::from_fn(|c| values.iter().map(|value| value[c]).sum::<f64>() / values.len() as f64)
}

#[test]
fn table_is_large_with_plausible_tile_sizes() {
    assert!(Texture::PERTURBATION.len() >= 55 && !Texture::PERTURBATION.contains(&Maple));
    for texture in Texture::PERTURBATION {
        assert!((0.15..=1.2).contains(&image(*texture).tile_m), "{texture:?}");
    }
}

#[test]
fn padding_repeats_rows_and_columns() {
    for texture in Texture::ALL {
        let texels = &image(*texture).texels;
        assert_eq!(texels.len(), PITCH * PITCH);
        for (i, texel) in texels.iter().enumerate() {
            let (x, y) = (i % PITCH % SIDE, i / PITCH % SIDE);
            assert_eq!(*texel, texels[y * PITCH + x], "{texture:?}, texel {i}");
        }
    }
}

#[test]
fn textures_tile_seamlessly() {
    for texture in Texture::ALL {
        let texels = factors(*texture);
        // Mean difference between neighbouring texels i and i + 1 across the tile, indexed by i.
        let jumps = |texel: &dyn Fn(usize, usize) -> [f64; 3]| -> Vec<f64> {
            let jump = |i: usize, k: usize| difference(texel(i, k), texel((i + 1) % SIDE, k));
            (0..SIDE).map(|i| (0..SIDE).map(|k| jump(i, k)).sum::<f64>() / SIDE as f64).collect()
        };
        let along_u = jumps(&|i, k| texels[k * SIDE + i]);
        let along_v = jumps(&|i, k| texels[i * SIDE + k]);
        for jumps in [along_u, along_v] {
            let (seam, interior) = (jumps[SIDE - 1], &jumps[..SIDE - 1]);
            let largest = interior.iter().copied().fold(0.0, f64::max);
            assert!(seam <= largest + 1e-9, "{texture:?}: {seam} at the seam, at most {largest} elsewhere");
        }
    }
}

#[test]
fn textures_have_contrast() {
    for texture in Texture::PERTURBATION.iter().filter(|texture| !GRADIENTS.contains(texture)) {
        let texels = factors(*texture);
        let middle = mean(&texels);
        let squares = texels.iter().map(|texel| difference(*texel, middle).powi(2)).sum::<f64>();
        let deviation = (squares / texels.len() as f64).sqrt() / middle.iter().sum::<f64>() * 3.0;
        assert!(deviation > 0.04, "{texture:?}: deviation {deviation} of the mean");
    }
}

#[test]
fn textures_differ_pairwise() {
    // Comparing the means of blocks keeps the quadratic number of pairs cheap.
    const BLOCK: usize = 8;
    let coarse = |texture: &Texture| -> Vec<[f64; 3]> {
        let side = SIDE / BLOCK;
        let mut means = vec![[0.0; 3]; side * side];
        for (i, texel) in factors(*texture).into_iter().enumerate() {
            let block = &mut means[i / SIDE / BLOCK * side + i % SIDE / BLOCK];
            *block = core::array::from_fn(|c| block[c] + texel[c] / (BLOCK * BLOCK) as f64);
        }
        means
    };
    let all: Vec<_> = Texture::ALL.iter().map(coarse).collect();
    for (i, a) in all.iter().enumerate() {
        for (k, b) in all.iter().enumerate().skip(i + 1) {
            let distance = a.iter().zip(b).map(|(a, b)| difference(*a, *b)).sum::<f64>() / a.len() as f64;
            assert!(
                distance > 0.01,
                "{:?} and {:?} differ by only {distance}",
                Texture::ALL[i],
                Texture::ALL[k]
            );
        }
    }
}

#[test]
fn mean_brightness_matches_photographs() {
    let encoded = |linear: f64| {
        let curve =
            if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 };
        255.0 * curve
    };
    let means: Vec<_> = Texture::PERTURBATION
        .iter()
        .map(|texture| mean(&factors(*texture).into_iter().map(|rgb| rgb.map(encoded)).collect::<Vec<_>>()))
        .collect();
    let found = mean(&means);
    let expected = [149.0, 134.0, 123.0];
    assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 15.0), "{found:?}, expected {expected:?}");
}
