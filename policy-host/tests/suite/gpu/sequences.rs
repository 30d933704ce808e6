//! The GPU kernels of language models, each against a plain computation in f64, on a software Vulkan driver.

use half::{bf16, f16};
use policy_host::nn::gpu::DeviceBuffer;
use policy_host::nn::gpu::ops::{DeviceWeights, ProductEpilogue, SampleRows};
use policy_host::nn::gpu::sequences::{RotaryRows, RowNorm, SequenceInput, SequenceShape, SequenceSpan};
use policy_host::weights::{MODEL_FILE, StoredTensor, TensorFolder};
use safetensors::tensor::{Dtype, TensorView};

use crate::gpu::device;
use crate::gpu::kernels::{N_SAMPLES, check, gelu, values};

/// Writes matrices `[n, k]` of one type to a file and returns them with their rounded values `[Σ n, k]`.
fn stored(dtype: Dtype, k: usize, rows: &[usize]) -> (Vec<StoredTensor>, Vec<f64>) {
    let folder = tempfile::tempdir().unwrap();
    let (mut bytes, mut rounded) = (Vec::new(), Vec::new());
    for (idx, n) in rows.iter().enumerate() {
        let mut matrix = Vec::new();
        for x in values(&format!("matrix {idx}"), n * k) {
            match dtype {
                Dtype::BF16 => {
                    matrix.extend(bf16::from_f32(x).to_le_bytes());
                    rounded.push(bf16::from_f32(x).to_f64());
                }
                Dtype::F16 => {
                    matrix.extend(f16::from_f32(x).to_le_bytes());
                    rounded.push(f16::from_f32(x).to_f64());
                }
                _ => {
                    matrix.extend(x.to_le_bytes());
                    rounded.push(f64::from(x));
                }
            }
        }
        bytes.push(matrix);
    }
    let views = rows
        .iter()
        .zip(&bytes)
        .enumerate()
        .map(|(idx, (n, bytes))| (idx.to_string(), TensorView::new(dtype, vec![*n, k], bytes).unwrap()));
    safetensors::serialize_to_file(views, None, &folder.path().join(MODEL_FILE)).unwrap();
    let tensors = TensorFolder::open(folder.path()).unwrap();
    ((0..rows.len()).map(|idx| tensors.tensor(&idx.to_string()).unwrap()).collect(), rounded)
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn stored_weights_agree_with_f64() {
    let n_rows = 29;
    for (dtype, k) in [(Dtype::F32, 37), (Dtype::BF16, 38), (Dtype::BF16, 35), (Dtype::F16, 50)] {
        let (tensors, weights) = stored(dtype, k, &[60, 19]);
        let n = 79;
        let (a, bias, out) =
            (values("a", N_SAMPLES * n_rows * k), values("b", n), values("out", N_SAMPLES * n_rows * n));
        let product = |row: usize, col: usize| -> f64 {
            (0..k).map(|i| f64::from(a[row * k + i]) * weights[col * k + i]).sum()
        };
        let places = || (0..N_SAMPLES * n_rows).flat_map(|row| (0..n).map(move |col| (row, col)));
        let expected: Vec<f64> =
            places().map(|(row, col)| gelu(product(row, col) + f64::from(bias[col]))).collect();
        check(&format!("{dtype:?}"), (&out, &expected), |ops, out| {
            let layer = DeviceWeights::stored(ops.gpu, &tensors, &bias).unwrap();
            let (a, rows) = (DeviceBuffer::of(ops.gpu, "a", &a), SampleRows::all(n_rows));
            ops.linear(&layer, n_rows, (&a, rows, None), (out, rows), ProductEpilogue::Gelu)
        });
        let gated = |(row, col): (usize, usize)| {
            f64::from(out[row * n + col]) + f64::from(bias[col]) * product(row, col)
        };
        let expected: Vec<f64> = places().map(gated).collect();
        check(&format!("gated {dtype:?}"), (&out, &expected), |ops, out| {
            let layer = DeviceWeights::stored(ops.gpu, &tensors, &[]).unwrap();
            let [a, gate] = [&a, &bias].map(|values| DeviceBuffer::of(ops.gpu, "input", values));
            ops.gated_linear(&layer, n_rows, &a, &gate, out)
        });
    }
}

/// The file is as long as its header says, but has no contents.
#[test]
#[ignore = "needs a Vulkan driver"]
fn matrix_beyond_the_device_is_refused() {
    let gpu = device();
    let (n, k) = (gpu.max_buffer_bytes() / 4096 + 1, 1024_u64);
    let n_bytes = n * k * 4;
    let header = format!(r#"{{"0":{{"dtype":"F32","shape":[{n},{k}],"data_offsets":[0,{n_bytes}]}}}}"#);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(MODEL_FILE);
    std::fs::write(&path, [&(header.len() as u64).to_le_bytes()[..], header.as_bytes()].concat()).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(8 + header.len() as u64 + n_bytes).unwrap();
    let tensor = TensorFolder::open(folder.path()).unwrap().tensor("0").unwrap();
    let error = DeviceWeights::stored(&gpu, &[tensor], &[]).unwrap_err().to_string();
    let limit = gpu.max_buffer_bytes().to_string();
    crate::assert_contains(&error, &[&format!("[{n}, {k}] of f32"), &n_bytes.to_string(), &limit]);
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn row_normalisations_agree_with_f64() {
    let (n_rows, width) = (11, 150);
    let x = values("x", N_SAMPLES * n_rows * width);
    let (scale, shift) = (values("scale", width), values("shift", width));
    for norm in [RowNorm::Layer(1e-6), RowNorm::Rms(1e-3)] {
        let mut expected = Vec::new();
        for row in x.chunks_exact(width) {
            let mean_of =
                |f: &dyn Fn(f64) -> f64| row.iter().map(|x| f(f64::from(*x))).sum::<f64>() / width as f64;
            let (mean, epsilon) = match norm {
                RowNorm::Layer(epsilon) => (mean_of(&|x| x), epsilon),
                RowNorm::Rms(epsilon) => (0.0, epsilon),
            };
            let rms = (mean_of(&|x| (x - mean).powi(2)) + f64::from(epsilon)).sqrt();
            let parts = row.iter().zip(&scale).zip(&shift);
            expected.extend(parts.map(|((x, scale), shift)| {
                (f64::from(*x) - mean) / rms * f64::from(*scale) + f64::from(*shift)
            }));
        }
        check(&format!("{norm:?}"), (&vec![0.0; x.len()], &expected), |ops, out| {
            let [x, scale, shift] =
                [&x, &scale, &shift].map(|values| DeviceBuffer::of(ops.gpu, "input", values));
            ops.normalise(norm, (n_rows, width), &x, (&scale, &shift), out)
        });
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn rotation_gathering_and_sum_agree_with_f64() {
    let rows = RotaryRows { n_rows: 7, stride: 40, n_heads: 3, head_width: 10 };
    let x = values("x", N_SAMPLES * rows.n_rows * rows.stride);
    let angles = values("angles", 12 * 5 * 2);
    let positions: Vec<u32> = (0..(N_SAMPLES * rows.n_rows) as u32).map(|row| row * 5 % 12).collect();
    let mut expected: Vec<f64> = x.iter().map(|x| f64::from(*x)).collect();
    for (row, position) in expected.chunks_exact_mut(rows.stride).zip(&positions) {
        for head in row.chunks_exact_mut(10).take(rows.n_heads) {
            for i in 0..5 {
                let [cos, sin] =
                    [0, 1].map(|part| f64::from(angles[(*position as usize * 5 + i) * 2 + part]));
                (head[i], head[i + 5]) =
                    (head[i] * cos - head[i + 5] * sin, head[i + 5] * cos + head[i] * sin);
            }
        }
    }
    check("rotation", (&x, &expected), |ops, out| {
        let angles = DeviceBuffer::of(ops.gpu, "angles", &angles);
        let positions = DeviceBuffer::of(ops.gpu, "positions", &positions);
        ops.rotate(rows, (&angles, &positions), out)
    });

    let (width, index) = (300, [4_u32, 1, 5]);
    let tables = [values("first", 3 * width), values("second", 3 * width)];
    let row = |i: &u32| tables[*i as usize % 2][*i as usize / 2 * width..][..width].iter();
    let expected: Vec<f64> = index.iter().flat_map(row).map(|x| f64::from(*x)).collect();
    check("gathering", (&vec![0.0; expected.len()], &expected), |ops, out| {
        let [first, second] = tables.each_ref().map(|table| DeviceBuffer::of(ops.gpu, "table", table));
        let index = DeviceBuffer::of(ops.gpu, "index", &index);
        ops.gather(width, [&first, &second], &index, out)
    });

    let y = values("y", x.len());
    let expected: Vec<f64> = x.iter().zip(&y).map(|(x, y)| f64::from(*x) - 0.1 * f64::from(*y)).collect();
    check("sum", (&x, &expected), |ops, out| {
        let y = DeviceBuffer::of(ops.gpu, "y", &y);
        ops.add_scaled(-0.1, x.len() / N_SAMPLES, &y, out)
    });
}

/// Lengths of the sequences, around whole blocks of keys.
const LENGTHS: [usize; N_SAMPLES] = [33, 7, 64];

#[test]
#[ignore = "needs a Vulkan driver"]
fn attention_of_sequences_agrees_with_f64() {
    for (n_heads, head_width, shares_keys, suffix) in [(3, 72, false, 0), (8, 16, true, 0), (2, 256, true, 5)]
    {
        // With a suffix, its rows are the queries.
        let (width, n_keys) = (n_heads * head_width, if shares_keys { 1 } else { n_heads });
        let key_width = n_keys * head_width;
        let n_rows: usize = LENGTHS.iter().sum();
        let n_queries = if suffix > 0 { N_SAMPLES * suffix } else { n_rows };
        let queries = values("queries", n_queries * width);
        let prefix = values("prefix", n_rows * 2 * key_width);
        let further = values("suffix", N_SAMPLES * suffix * 2 * key_width);
        let (mut spans, mut expected, mut first) = (Vec::new(), vec![0.0; queries.len()], 0);
        for (sample, length) in LENGTHS.into_iter().enumerate() {
            let (first_query, count) = if suffix > 0 { (sample * suffix, suffix) } else { (first, length) };
            let rows: Vec<&[f32]> = prefix
                .chunks_exact(2 * key_width)
                .skip(first)
                .take(length)
                .chain(further.chunks_exact(2 * key_width).skip(sample * suffix).take(suffix))
                .collect();
            for (query, head) in
                (first_query..first_query + count).flat_map(|q| (0..n_heads).map(move |h| (q, h)))
            {
                let at = query * width + head * head_width;
                let key_at = if shares_keys { 0 } else { head * head_width };
                let weight = |row: &&[f32]| {
                    let terms =
                        (0..head_width).map(|i| f64::from(queries[at + i]) * f64::from(row[key_at + i]));
                    libm::exp(terms.sum::<f64>() / (head_width as f64).sqrt())
                };
                let weights: Vec<f64> = rows.iter().map(weight).collect();
                for i in 0..head_width {
                    let value = |row: &&[f32]| f64::from(row[key_width + key_at + i]);
                    let sum: f64 = rows.iter().zip(&weights).map(|(row, weight)| weight * value(row)).sum();
                    expected[at + i] = sum / weights.iter().sum::<f64>();
                }
            }
            let span = [first_query, count, first, length].map(|x| x as u32);
            spans.push(bytemuck::cast::<_, SequenceSpan>(span));
            first += length;
        }
        let shape = SequenceShape { n_heads, head_width, shares_keys, max_queries: 64, suffix };
        check(&format!("{shape:?}"), (&vec![0.0; expected.len()], &expected), |ops, out| {
            let [queries, prefix, further] =
                [&queries, &prefix, &further].map(|values| DeviceBuffer::of(ops.gpu, "input", values));
            let spans = DeviceBuffer::of(ops.gpu, "spans", &spans);
            let input = SequenceInput { queries: &queries, prefix: &prefix, suffix: &further, spans: &spans };
            ops.sequence_attention(shape, input, out).unwrap()
        });
    }
}
