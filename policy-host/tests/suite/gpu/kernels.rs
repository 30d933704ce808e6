//! Each GPU kernel against a plain computation in f64, on a software Vulkan driver.

use policy_host::generated::{fnv1a64, sym};
use policy_host::nn::conv::ConvGeometry;
use policy_host::nn::gpu::ops::{
    AttentionShape, DeviceMaps, DeviceWeights, OpBuilder, ProductEpilogue, SampleRows,
};
use policy_host::nn::gpu::steps::{NetworkStep, StepRun};
use policy_host::nn::gpu::transfer::{BatchArray, BatchQueue, UnitCounter};
use policy_host::nn::gpu::{DeviceBuffer, Dispatch, KernelCache};

use crate::gpu::device;

pub(crate) const N_SAMPLES: usize = 3;
const TOLERANCE: f64 = 1e-5;

/// Returns `len` values in [-1, 1), the same for the same name.
pub(crate) fn values(name: &str, len: usize) -> Vec<f32> {
    (0..len).map(|idx| sym(fnv1a64(name), idx, 1.0)).collect()
}

/// Builds a dispatch with `build`, runs it on `out`, and compares the result.
pub(crate) fn check(
    what: &str,
    (out, expected): (&[f32], &[f64]),
    build: impl FnOnce(&mut OpBuilder<'_>, &DeviceBuffer) -> Dispatch,
) {
    let found = compute(out, build);
    assert_eq!(found.len(), expected.len());
    for (idx, (x, y)) in found.iter().zip(expected).enumerate() {
        assert!((f64::from(*x) - y).abs() < TOLERANCE, "{what}, value {idx}: {x}, expected {y}");
    }
}

/// Builds a dispatch with `build`, runs it on `out`, and returns the result.
fn compute(out: &[f32], build: impl FnOnce(&mut OpBuilder<'_>, &DeviceBuffer) -> Dispatch) -> Vec<f32> {
    let gpu = device();
    let samples = UnitCounter { count: DeviceBuffer::uniform(&gpu, "batch"), capacity: N_SAMPLES };
    // The length of the result need not be a multiple of the number of samples.
    let whole = UnitCounter { count: DeviceBuffer::uniform(&gpu, "batch"), capacity: 1 };
    let buffer = DeviceBuffer::of(&gpu, "out", out);
    let mut ops = OpBuilder { gpu: &gpu, kernels: KernelCache::default(), batch: &samples.count };
    let run = StepRun { unit: 0, steps: vec![NetworkStep::Run(build(&mut ops, &buffer))] };
    let result = BatchArray { buffer, unit: 1, n_words: out.len() };
    let mut queue = BatchQueue::new([samples, whole], Vec::new(), vec![run], result);
    let batch = queue.submit(&gpu, [N_SAMPLES, 1], &|_, _| &[]).unwrap();
    let mut found = Vec::new();
    queue.collect(&gpu, batch, |values| found.extend_from_slice(values)).unwrap();
    found
}

/// Returns GELU in the form with tanh.
pub(crate) fn gelu(x: f64) -> f64 {
    0.5 * x * (1.0 + libm::tanh((2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x.powi(3))))
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn linear_layers_agree_with_f64() {
    // Neither rows nor columns nor terms fill whole tiles.
    let (n_rows, k, n) = (41, 37, 70);
    let (from, to) = (SampleRows { first: 2, of: 50 }, SampleRows { first: 1, of: 43 });
    let a = values("a", N_SAMPLES * from.of * k);
    let (weights, bias) = (values("w", k * n), values("b", n));
    let positions = values("p", n_rows * k);
    for (positions, epilogue) in [
        (None, ProductEpilogue::Store),
        (Some(&positions), ProductEpilogue::Relu),
        (Some(&positions), ProductEpilogue::Add),
        (None, ProductEpilogue::AddRelu),
        (None, ProductEpilogue::Gelu),
        (None, ProductEpilogue::Multiply),
    ] {
        let out = values("out", N_SAMPLES * to.of * n);
        let mut expected: Vec<f64> = out.iter().map(|x| f64::from(*x)).collect();
        for (row, col) in (0..N_SAMPLES * n_rows).flat_map(|row| (0..n).map(move |col| (row, col))) {
            let (sample, i) = (row / n_rows, row % n_rows);
            let term = |at: usize| {
                let x = f64::from(a[(sample * from.of + from.first + i) * k + at]);
                let x = x + positions.map_or(0.0, |positions| f64::from(positions[i * k + at]));
                x * f64::from(weights[at * n + col])
            };
            let sum = (0..k).map(term).sum::<f64>() + f64::from(bias[col]);
            let out = &mut expected[(sample * to.of + to.first + i) * n + col];
            *out = match epilogue {
                ProductEpilogue::Store => sum,
                ProductEpilogue::Relu => sum.max(0.0),
                ProductEpilogue::Add => *out + sum,
                ProductEpilogue::AddRelu => (*out + sum).max(0.0),
                ProductEpilogue::Gelu => gelu(sum),
                ProductEpilogue::Multiply => *out * sum,
            };
        }
        check(&format!("{epilogue:?}"), (&out, &expected), |ops, out| {
            let layer = DeviceWeights::new(ops.gpu, &weights, &bias);
            let a = DeviceBuffer::of(ops.gpu, "a", &a);
            let positions = positions.map(|values| DeviceBuffer::of(ops.gpu, "positions", values));
            ops.linear(&layer, n_rows, (&a, from, positions.as_ref()), (out, to), epilogue)
        });
    }
}

/// Terms of 16 bits would give errors ten times as large as permitted.
#[test]
#[ignore = "needs a Vulkan driver"]
fn long_sums_are_as_accurate_as_f32() {
    let (n_rows, k, n) = (23, 2048, 70);
    let magnitude = |idx: usize| [1e-3, 0.1, 1.0, 30.0][idx % 4];
    let inputs = values("a", N_SAMPLES * n_rows * k).into_iter().enumerate();
    let a: Vec<f32> = inputs.map(|(idx, x)| x * magnitude(idx)).collect();
    let (weights, bias) = (values("w", k * n), vec![0.0; n]);
    let term =
        |row: usize, col: usize, at: usize| f64::from(a[row * k + at]) * f64::from(weights[at * n + col]);
    let cells = || (0..N_SAMPLES * n_rows).flat_map(|row| (0..n).map(move |col| (row, col)));
    let sum = |f: fn(f64) -> f64| -> Vec<f64> {
        cells().map(|(row, col)| (0..k).map(|at| f(term(row, col, at))).sum()).collect()
    };
    let (expected, sizes) = (sum(|x| x), sum(f64::abs));
    let found = compute(&vec![0.0; expected.len()], |ops, out| {
        let layer = DeviceWeights::new(ops.gpu, &weights, &bias);
        let a = DeviceBuffer::of(ops.gpu, "a", &a);
        let rows = SampleRows::all(n_rows);
        ops.linear(&layer, n_rows, (&a, rows, None), (out, rows), ProductEpilogue::Store)
    });
    let errors =
        found.iter().zip(&expected).zip(&sizes).map(|((x, y), size)| (f64::from(*x) - y).abs() / size);
    let largest = errors.fold(0.0, f64::max);
    assert!(largest < 6e-7, "relative to the sum of sizes, the largest error is {largest:.1e}");
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn convolutions_agree_with_f64() {
    let (c, c_out) = (5, 9);
    let maps = DeviceMaps { images: 2, height: 7, width: 10, channels: c };
    for (kernel_size, stride, padding) in [(7, 2, 3), (3, 1, 1), (3, 2, 1), (1, 2, 0)] {
        let geometry = ConvGeometry { kernel_size, stride, padding };
        let a = values("maps", N_SAMPLES * maps.len());
        let (weights, bias) = (values("kernel", kernel_size * kernel_size * c * c_out), values("b", c_out));
        let output = maps.convolved(geometry, c_out);
        let mut expected = Vec::new();
        for pixel in 0..N_SAMPLES * output.n_pixels() {
            let (x, y) = (pixel % output.width, pixel / output.width % output.height);
            let image = pixel / output.width / output.height;
            for (channel, bias) in bias.iter().enumerate() {
                let mut sum = f64::from(*bias);
                for tap in 0..kernel_size * kernel_size {
                    let row = (y * stride + tap / kernel_size).wrapping_sub(padding);
                    let col = (x * stride + tap % kernel_size).wrapping_sub(padding);
                    if row >= maps.height || col >= maps.width {
                        continue;
                    }
                    for i in 0..c {
                        let value = a[((image * maps.height + row) * maps.width + col) * c + i];
                        sum += f64::from(value) * f64::from(weights[(tap * c + i) * c_out + channel]);
                    }
                }
                expected.push(sum);
            }
        }
        let out = vec![0.0; expected.len()];
        check(&format!("{geometry:?}"), (&out, &expected), |ops, out| {
            let layer = DeviceWeights::new(ops.gpu, &weights, &bias);
            let a = DeviceBuffer::of(ops.gpu, "maps", &a);
            ops.conv(&layer, geometry, (&a, maps), out, ProductEpilogue::Store)
        });
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn attention_agrees_with_f64() {
    let shape = AttentionShape { n_queries: 13, n_keys: 75, width: 24, n_heads: 2, optional_key: Some(4) };
    let AttentionShape { n_queries, n_keys, width, n_heads, .. } = shape;
    let queries = values("q", N_SAMPLES * n_queries * width);
    let (keys, inputs) = (values("k", N_SAMPLES * n_keys * width), values("v", N_SAMPLES * n_keys * width));
    let present = [1_u32, 0, 1];
    let head = width / n_heads;
    let mut expected = vec![0.0; queries.len()];
    for (sample, query) in (0..N_SAMPLES).flat_map(|sample| (0..n_queries).map(move |q| (sample, q))) {
        for first in (0..n_heads).map(|idx| idx * head) {
            let at = (sample * n_queries + query) * width + first;
            let row = |key: usize| (sample * n_keys + key) * width + first;
            let weight = |key: usize| {
                let terms = (0..head).map(|i| f64::from(queries[at + i]) * f64::from(keys[row(key) + i]));
                if key == 4 && present[sample] == 0 { 0.0 } else { libm::exp(terms.sum()) }
            };
            let weights: Vec<f64> = (0..n_keys).map(weight).collect();
            for i in 0..head {
                let sum: f64 = (0..n_keys).map(|key| weights[key] * f64::from(inputs[row(key) + i])).sum();
                expected[at + i] = sum / weights.iter().sum::<f64>();
            }
        }
    }
    check("attention", (&vec![0.0; expected.len()], &expected), |ops, out| {
        let [queries, keys, inputs] =
            [&queries, &keys, &inputs].map(|values| DeviceBuffer::of(ops.gpu, "input", values));
        let present = DeviceBuffer::of(ops.gpu, "present", &present);
        ops.attention(shape, [&queries, &keys, &inputs], &present, out).unwrap()
    });
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn pooling_and_normalisation_agree_with_f64() {
    let maps = DeviceMaps { images: 2, height: 7, width: 10, channels: 3 };
    let a = values("maps", N_SAMPLES * maps.len());
    let (height, width) = (4, 5);
    let mut expected = Vec::new();
    for pixel in 0..N_SAMPLES * maps.images * height * width {
        let (x, y, image) = (pixel % width, pixel / width % height, pixel / width / height);
        for channel in 0..3 {
            let rows = (2 * y).saturating_sub(1)..(2 * y + 2).min(maps.height);
            let window = rows.flat_map(|row| {
                let columns = (2 * x).saturating_sub(1)..(2 * x + 2).min(maps.width);
                columns.map(move |col| ((image * maps.height + row) * maps.width + col) * 3 + channel)
            });
            expected.push(window.map(|at| f64::from(a[at])).fold(f64::MIN, f64::max));
        }
    }
    check("max pool", (&vec![0.0; expected.len()], &expected), |ops, out| {
        let a = DeviceBuffer::of(ops.gpu, "maps", &a);
        ops.max_pool((&a, maps), out)
    });

    let (n_rows, width) = (11, 150);
    let x = values("x", N_SAMPLES * n_rows * width);
    let (weight, bias) = (values("weight", width), values("bias", width));
    let normalised = x.chunks_exact(width).flat_map(|row| {
        let mean = row.iter().map(|x| f64::from(*x)).sum::<f64>() / width as f64;
        let variance = row.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / width as f64;
        let scale = 1.0 / (variance + 1e-5).sqrt();
        let parts = row.iter().zip(&weight).zip(&bias);
        parts.map(move |((x, w), b)| (f64::from(*x) - mean) * scale * f64::from(*w) + f64::from(*b))
    });
    let expected: Vec<f64> = normalised.collect();
    check("layer norm", (&x, &expected), |ops, out| {
        let [weight, bias] = [&weight, &bias].map(|values| DeviceBuffer::of(ops.gpu, "affine", values));
        ops.layer_norm((&weight, &bias), (n_rows, width), out)
    });
}
