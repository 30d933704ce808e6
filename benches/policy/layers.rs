//! The time of a query of full-size single-arm ACT, layer by layer.
//!
//! Every layer is measured alone, on all threads at once, with the number of images or tokens that it has in
//! a batch of eight queries. The threads share its weights. Successive passes use different copies of the
//! layer, 64 MB of weights or 64 copies, so that large weights are as cold as in a query. Each line gives the
//! core time per query, its share of the query, the rate of operations (counted for the direct algorithm) and
//! its fraction of the register peak, and the rate at which all threads read weights as they are stored. The
//! layers do not include attention between tokens, normalisations, pooling and the preparation of images.

use std::sync::Barrier;
use std::time::{Duration, Instant};

use anyhow::Result;
use benches::{Report, median};
use ipc_types::Morphology;
use policy_host::generated::unit;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic;
use policy_host::nn::Precision;
use policy_host::nn::conv::feature_map::FeatureMapShape;
use policy_host::nn::conv::{Conv2d, ConvGeometry, ConvScratch, Epilogue, FrozenBatchNorm2d};
use policy_host::nn::gemm::peak::peak_gflop_per_s;
use policy_host::nn::linear::Linear;

use super::{Batch, MIN_ROUNDS};

/// Minimum measuring time per layer.
const LAYER_TIME: Duration = Duration::from_millis(500);
/// Weights of all copies of a layer, in bytes.
const COPIES_BYTES: usize = 64 << 20;
/// Samples that a thread computes together, and images of each.
const SAMPLES: usize = 4;
const IMAGES: usize = 3;

/// Measures the layers and whole queries, in f32 and with 8-bit weights.
pub(crate) fn layers(n_threads: usize, report: &mut Report) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
    let config = ActConfig::full_size(Morphology::Single);
    for precision in [Precision::F32, Precision::Int8] {
        let mut policy = synthetic::policy(&config, 0, precision, n_threads);
        let mut batch = Batch::new(Morphology::Single, 2 * SAMPLES);
        let rounds = (0..MIN_ROUNDS + 2).map(|_| pool.install(|| batch.run(&mut policy)));
        let whole_s = median(&mut rounds.collect::<Result<Vec<f64>>>()?) / (2 * SAMPLES) as f64;
        table(precision, 1e3 * whole_s, n_threads, report);
    }
    Ok(())
}

/// Measures all layers. `whole_ms` is the time per query of a batch of eight.
fn table(precision: Precision, whole_ms: f64, n_threads: usize, report: &mut Report) {
    let name = if precision == Precision::F32 { "f32" } else { "int8" };
    let note = format!("{n_threads} threads together");
    println!(
        "layers, {name}: core-ms per query, share, GFLOP/s, fraction of the register peak, GB/s of weights"
    );
    let whole_ms = whole_ms * n_threads as f64;
    let (mut sum_ms, mut peaks) = (0.0, Vec::new());
    for kind in kinds() {
        let peak = peak_gflop_per_s(n_threads);
        let (pass_s, weight_bytes) = time(kind.shape, precision, n_threads);
        let per_pass = kind.shape.per_pass() as f64;
        let core_ms = 1e3 * pass_s * kind.count as f64 / per_pass;
        let rate = kind.shape.flop() * per_pass * n_threads as f64 / pass_s / 1e9;
        let bandwidth = (weight_bytes * n_threads) as f64 / pass_s / 1e9;
        println!(
            "  {:20} {core_ms:6.2} {:4.1} % {rate:6.0} {:4.0} % {bandwidth:6.1}",
            kind.name,
            100.0 * core_ms / whole_ms,
            100.0 * rate / peak
        );
        let case = format!("layer_{name}_{}", kind.name.replace([' ', ','], "_"));
        report.add(&case, core_ms, "core_ms_per_query", &note);
        report.add(&case, rate / peak, "of_register_peak", &note);
        report.add(&case, bandwidth, "weights_gb_per_s", &note);
        sum_ms += core_ms;
        peaks.push(peak);
    }
    println!(
        "  all layers {sum_ms:.1} core-ms, whole query {whole_ms:.1}; register peak {:.0} GFLOP/s",
        median(&mut peaks)
    );
}

/// Returns the time of a pass in s while all threads are computing, and the bytes of a layer's weights.
fn time(shape: LayerShape, precision: Precision, n_threads: usize) -> (f64, usize) {
    let first = shape.build(precision);
    let weight_bytes = first.weight_bytes();
    let n_copies = (COPIES_BYTES / weight_bytes).clamp(2, 64);
    let copies: Vec<Layer> =
        std::iter::once(first).chain((1..n_copies).map(|_| shape.build(precision))).collect();
    let start = Barrier::new(n_threads);
    let passes = || {
        let mut buffers = shape.buffers(&copies[0]);
        let mut seconds = Vec::new();
        start.wait();
        let started = Instant::now();
        while started.elapsed() < LAYER_TIME {
            for layer in &copies {
                let began = Instant::now();
                shape.run(layer, &mut buffers);
                seconds.push(began.elapsed().as_secs_f64());
            }
        }
        median(&mut seconds)
    };
    let mut seconds: Vec<f64> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..n_threads).map(|_| scope.spawn(passes)).collect();
        threads.into_iter().map(|thread| thread.join().expect("layers do not panic")).collect()
    });
    (median(&mut seconds), weight_bytes)
}

/// A kind of layer: its name, how often it occurs in a query of one sample, and its shape.
struct LayerKind {
    name: &'static str,
    count: usize,
    shape: LayerShape,
}

#[derive(Clone, Copy)]
enum LayerShape {
    /// Channels in and out, geometry, side of the input, and the images that pass together.
    Conv { c_in: usize, c_out: usize, geometry: ConvGeometry, side: usize, images: usize },
    /// Rows of a sample, features in and out.
    Linear { rows: usize, from: usize, to: usize },
}

/// Returns the layers of ACT's full size for one arm, three cameras and a state and an instruction token.
fn kinds() -> Vec<LayerKind> {
    let conv = |name, count, (c_in, c_out), (kernel_size, stride, padding), side, images| LayerKind {
        name,
        count: count * IMAGES,
        shape: LayerShape::Conv {
            c_in,
            c_out,
            geometry: ConvGeometry { kernel_size, stride, padding },
            side,
            images,
        },
    };
    let linear =
        |name, count, rows, from, to| LayerKind { name, count, shape: LayerShape::Linear { rows, from, to } };
    let late = SAMPLES * IMAGES;
    vec![
        conv("stem 7x7 /2", 1, (3, 64), (7, 2, 3), 224, 1),
        conv("layer1 3x3", 4, (64, 64), (3, 1, 1), 56, 1),
        conv("layer2 3x3 /2", 1, (64, 128), (3, 2, 1), 56, 1),
        conv("layer2 1x1 /2", 1, (64, 128), (1, 2, 0), 56, 1),
        conv("layer2 3x3", 3, (128, 128), (3, 1, 1), 28, 1),
        conv("layer3 3x3 /2", 1, (128, 256), (3, 2, 1), 28, late),
        conv("layer3 1x1 /2", 1, (128, 256), (1, 2, 0), 28, late),
        conv("layer3 3x3", 3, (256, 256), (3, 1, 1), 14, late),
        conv("layer4 3x3 /2", 1, (256, 512), (3, 2, 1), 14, late),
        conv("layer4 1x1 /2", 1, (256, 512), (1, 2, 0), 14, late),
        conv("layer4 3x3", 3, (512, 512), (3, 1, 1), 7, late),
        linear("image tokens", 1, 147, 512, 512),
        linear("encoder q, k, v, out", 16, 150, 512, 512),
        linear("encoder FFN in", 4, 150, 512, 1600),
        linear("encoder FFN out", 4, 150, 1600, 512),
        linear("decoder k, v", 2, 150, 512, 512),
        linear("decoder out", 1, 30, 512, 512),
        linear("decoder FFN in", 1, 30, 512, 1600),
        linear("decoder FFN out", 1, 30, 1600, 512),
    ]
}

/// A layer of either kind.
enum Layer {
    Conv(Conv2d),
    Linear(Linear),
}

/// Input, output and scratch of one thread.
struct Buffers {
    input: Vec<f32>,
    output: Vec<f32>,
    scratch: ConvScratch,
}

impl Layer {
    fn weight_bytes(&self) -> usize {
        match self {
            Self::Conv(conv) => conv.weight_bytes(),
            Self::Linear(linear) => linear.weight_bytes(),
        }
    }
}

impl LayerShape {
    /// Returns the floating-point operations for one image or one sample, by the direct algorithm.
    fn flop(self) -> f64 {
        let macs = match self {
            Self::Conv { c_in, c_out, geometry, side, .. } => {
                let pixels = geometry.output_side(side).pow(2);
                pixels * geometry.kernel_size.pow(2) * c_in * c_out
            }
            Self::Linear { rows, from, to } => rows * from * to,
        };
        2.0 * macs as f64
    }

    /// Returns the number of weights.
    fn n_weights(self) -> usize {
        match self {
            Self::Conv { c_in, c_out, geometry, .. } => geometry.kernel_size.pow(2) * c_in * c_out,
            Self::Linear { from, to, .. } => from * to,
        }
    }

    /// Returns the number of images or samples per pass.
    fn per_pass(self) -> usize {
        match self {
            Self::Conv { images, .. } => images,
            Self::Linear { .. } => 1,
        }
    }

    fn build(self, precision: Precision) -> Layer {
        let weight: Vec<f32> = (0..self.n_weights()).map(|idx| unit(1, idx) - 0.5).collect();
        match self {
            Self::Conv { c_in, c_out, geometry, .. } => {
                let [ones, zeros] = [vec![1.0; c_out], vec![0.0; c_out]];
                let norm = FrozenBatchNorm2d { weight: &ones, bias: &zeros, mean: &zeros, variance: &ones };
                // As in the network: 8-bit convolutions need inputs that are not negative.
                let precision = if c_in == 3 { Precision::F32 } else { precision };
                Layer::Conv(Conv2d::with_batch_norm(&weight, norm, geometry, precision))
            }
            Self::Linear { to, .. } => {
                Layer::Linear(Linear::with_precision(&weight, &vec![0.0; to], precision))
            }
        }
    }

    /// Returns the shapes of the input and the output of a convolution.
    fn maps(self, conv: &Conv2d) -> [FeatureMapShape; 2] {
        let Self::Conv { c_in, geometry, side, images, .. } = self else { unreachable!("no convolution") };
        let padding = geometry.padding.max(1);
        let input = FeatureMapShape { batch: images, height: side, width: side, channels: c_in, padding };
        [input, conv.output_shape(input, 1)]
    }

    fn buffers(self, layer: &Layer) -> Buffers {
        let mut scratch = ConvScratch::default();
        let (n_in, n_out) = match (self, layer) {
            (_, Layer::Conv(conv)) => {
                let [input, output] = self.maps(conv);
                conv.reserve(input, &mut scratch);
                (input.len(), output.len())
            }
            (Self::Linear { rows, from, to }, Layer::Linear(_)) => (rows * from, rows * to),
            _ => unreachable!("built from this shape"),
        };
        let input = (0..n_in).map(|idx| unit(2, idx)).collect();
        Buffers { input, output: vec![0.0; n_out], scratch }
    }

    fn run(self, layer: &Layer, buffers: &mut Buffers) {
        let Buffers { input, output, scratch } = buffers;
        match layer {
            Layer::Conv(conv) => {
                let [from, to] = self.maps(conv);
                let rows = 0..to.n_rows();
                let output = &mut output[to.row_span(rows.clone())];
                conv.forward((input, from), (output, to), rows, Epilogue::Relu, scratch);
            }
            Layer::Linear(linear) => linear.forward(input, output),
        }
    }
}
