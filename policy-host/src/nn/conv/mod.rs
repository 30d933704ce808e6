//! 2-D convolutions of feature maps, with the following batch normalisation folded into the weights.
//!
//! 3×3 kernels with stride 1 use `winograd`. Others are GEMMs: wide output rows read their
//! windows in place; narrow rows go through im2col, a block of pixels at a time.
//! Every sum is the same chain of additions either way. With 8-bit weights all windows are read in place.

pub mod feature_map;
pub mod pool;

mod winograd;

use std::ops::Range;

use self::feature_map::FeatureMapShape;
use self::winograd::{LANES, Winograd, WinogradScratch};
use super::Precision;
use super::gemm::matmul::Accum;
use super::gemm::packed::PackedWeights;
use super::gemm::quantised::{QUAD, QuantisedWeights, Segments, quantise_unsigned};
use super::linear::rectified;

/// Number of values in an im2col block: 0.5 MiB, so that it stays in the L2 cache.
const IM2COL_BLOCK_LEN: usize = 1 << 17;
/// Minimum number of pixels in an im2col block, to amortise reading the weights once per block.
const IM2COL_MIN_PIXELS: usize = 256;
/// Minimum output width for reading windows in place, which reads the weights once per output row.
const MIN_IN_PLACE_WIDTH: usize = 24;

/// Geometry of a convolution, with PyTorch's meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConvGeometry {
    /// Height and width of the kernel, in pixels.
    pub kernel_size: usize,
    /// Distance between neighbouring windows, in pixels.
    pub stride: usize,
    /// Zero padding on each side of the input, in pixels.
    pub padding: usize,
}

impl ConvGeometry {
    /// Returns the output height or width for an input of `side` pixels.
    #[must_use]
    pub const fn output_side(self, side: usize) -> usize {
        (side + 2 * self.padding - self.kernel_size) / self.stride + 1
    }
}

/// A batch normalisation with fixed statistics, each `[c] f32`.
#[derive(Clone, Copy, Debug)]
pub struct FrozenBatchNorm2d<'a> {
    /// Scale `γ`, PyTorch's `weight`.
    pub weight: &'a [f32],
    /// Offset `β`, PyTorch's `bias`.
    pub bias: &'a [f32],
    /// Running mean of the training.
    pub mean: &'a [f32],
    /// Running variance of the training.
    pub variance: &'a [f32],
}

impl FrozenBatchNorm2d<'_> {
    /// Term added to the variance, as in torchvision's FrozenBatchNorm2d and the benchmark's copy of it.
    pub const EPSILON: f32 = 1e-5;

    /// Folds the normalisation into the convolution before it, with
    /// `weight [c_out, c_in, kernel_size, kernel_size]` and no bias. Returns GEMM weights
    /// `[kernel_size² · c_in, c_out]` and a bias `[c_out]`.
    ///
    /// # Panics
    /// If the lengths do not match.
    #[must_use]
    pub fn fold_into(&self, weight: &[f32], geometry: ConvGeometry) -> (Vec<f32>, Vec<f32>) {
        let c_out = self.weight.len();
        let area = geometry.kernel_size * geometry.kernel_size;
        let c_in = weight.len() / (c_out * area);
        assert_eq!(weight.len(), c_out * c_in * area, "weight [{c_out}, {c_in}, {area}]");
        let mut matrix = vec![0.0; weight.len()];
        let mut bias = vec![0.0; c_out];
        for out_idx in 0..c_out {
            let scale = self.weight[out_idx] / (self.variance[out_idx] + Self::EPSILON).sqrt();
            bias[out_idx] = self.bias[out_idx] - self.mean[out_idx] * scale;
            for in_idx in 0..c_in {
                for tap in 0..area {
                    let x = weight[(out_idx * c_in + in_idx) * area + tap];
                    matrix[(tap * c_in + in_idx) * c_out + out_idx] = x * scale;
                }
            }
        }
        (matrix, bias)
    }
}

/// Operation that writes the sums of a convolution, bias included, to the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Epilogue {
    /// `out = sum`.
    Store,
    /// `out = max(sum, 0)`.
    Relu,
    /// `out = max(out + sum, 0)`, the end of a residual block.
    AddRelu,
}

/// A 2-D convolution with bias.
#[derive(Clone, Debug)]
pub struct Conv2d {
    weights: ConvWeights,
    bias: Vec<f32>,
    geometry: ConvGeometry,
    c_in: usize,
    c_out: usize,
}

#[derive(Clone, Debug)]
enum ConvWeights {
    Winograd(Winograd),
    /// GEMM weights `[kernel_size² · c_in, c_out]`.
    Gemm(PackedWeights),
    /// 8-bit GEMM weights of the same shape.
    Int8(QuantisedWeights),
}

/// Working memory of convolutions.
#[derive(Clone, Debug, Default)]
pub struct ConvScratch {
    patches: Vec<f32>,
    sums: Vec<f32>,
    winograd: WinogradScratch,
    /// Quantised input, with the layout of the input.
    quantised: Vec<u8>,
    /// Quantisation scale `[n]` of each image.
    scales: Vec<f32>,
    /// Output pixels of the current call.
    pixels: Vec<OutputPixel>,
}

/// An output pixel of an 8-bit convolution.
#[derive(Clone, Copy, Debug)]
struct OutputPixel {
    /// Offset of its window in the input.
    start: usize,
    /// Offset of the pixel in the output.
    out: usize,
    /// Quantisation scale of its image.
    scale: f32,
}

impl Conv2d {
    /// Creates a bias-free convolution with `weight [c_out, c_in, kernel_size, kernel_size]`, followed by
    /// `norm`. With [`Precision::Int8`], inputs must be non-negative.
    ///
    /// # Panics
    /// If the lengths do not match.
    #[must_use]
    pub fn with_batch_norm(
        weight: &[f32],
        norm: FrozenBatchNorm2d<'_>,
        geometry: ConvGeometry,
        precision: Precision,
    ) -> Self {
        let (matrix, bias) = norm.fold_into(weight, geometry);
        let area = geometry.kernel_size * geometry.kernel_size;
        let c_out = bias.len();
        let c_in = matrix.len() / (c_out * area);
        let whole_lanes = c_in.is_multiple_of(LANES) && c_out.is_multiple_of(LANES);
        let weights = if precision == Precision::Int8 && c_in.is_multiple_of(QUAD) {
            ConvWeights::Int8(QuantisedWeights::new(&matrix, area * c_in, c_out))
        } else if whole_lanes && geometry == (ConvGeometry { kernel_size: 3, stride: 1, padding: 1 }) {
            ConvWeights::Winograd(Winograd::new(&matrix, c_in, c_out))
        } else {
            ConvWeights::Gemm(PackedWeights::new(&matrix, area * c_in, c_out))
        };
        Self { weights, bias, geometry, c_in, c_out }
    }

    /// Returns the size of the weights in memory, in the form that the algorithm needs.
    #[must_use]
    pub fn weight_bytes(&self) -> usize {
        match &self.weights {
            ConvWeights::Winograd(winograd) => winograd.size_bytes(),
            ConvWeights::Gemm(weights) => weights.size_bytes(),
            ConvWeights::Int8(weights) => weights.size_bytes(),
        }
    }

    /// Returns the granularity, in output rows, at which work should be divided between threads.
    #[must_use]
    pub fn row_granularity(&self) -> usize {
        match &self.weights {
            ConvWeights::Winograd(winograd) => winograd.output_side(),
            ConvWeights::Gemm(_) | ConvWeights::Int8(_) => 1,
        }
    }

    /// Returns the shape of the output, with `padding` pixels of padding.
    #[must_use]
    pub fn output_shape(&self, input: FeatureMapShape, padding: usize) -> FeatureMapShape {
        let [height, width] = [input.height, input.width].map(|side| self.geometry.output_side(side));
        FeatureMapShape { height, width, channels: self.c_out, padding, ..input }
    }

    /// Grows `scratch` to what [`forward`](Self::forward) needs for this input.
    pub fn reserve(&self, input: FeatureMapShape, scratch: &mut ConvScratch) {
        let output = self.output_shape(input, 0);
        match &self.weights {
            ConvWeights::Winograd(winograd) => return winograd.reserve(input, &mut scratch.winograd),
            ConvWeights::Int8(_) => {
                scratch.quantised.resize(scratch.quantised.len().max(input.len()), 0);
                scratch.scales.resize(scratch.scales.len().max(input.batch), 0.0);
                return scratch.pixels.reserve(output.n_rows() * output.width);
            }
            ConvWeights::Gemm(_) => {}
        }
        if output.width >= MIN_IN_PLACE_WIDTH {
            return scratch.sums.resize(scratch.sums.len().max(output.width * self.c_out), 0.0);
        }
        let n_pixels = self.im2col_pixels().min(output.n_rows() * output.width);
        let grow = |buffer: &mut Vec<f32>, len: usize| buffer.resize(buffer.len().max(len), 0.0);
        grow(&mut scratch.patches, n_pixels * self.patch_len());
        grow(&mut scratch.sums, n_pixels * self.c_out);
    }

    /// Computes these rows of the output. The input's padding must be at least that of the convolution.
    /// `output` is the memory of the rows ([`FeatureMapShape::row_span`]); its padding is not written.
    ///
    /// # Panics
    /// If a slice does not have its shape, or `scratch` was not reserved for this shape.
    pub fn forward(
        &self,
        (input, input_shape): (&[f32], FeatureMapShape),
        (output, output_shape): (&mut [f32], FeatureMapShape),
        rows: Range<usize>,
        epilogue: Epilogue,
        scratch: &mut ConvScratch,
    ) {
        assert_eq!(input.len(), input_shape.len(), "input {input_shape:?}");
        let span = output_shape.row_span(rows.clone());
        assert_eq!(output.len(), span.len(), "rows {rows:?} of {output_shape:?}");
        assert_eq!(input_shape.channels, self.c_in, "input channels");
        assert!(input_shape.padding >= self.geometry.padding, "input padding");
        assert_eq!(output_shape, self.output_shape(input_shape, output_shape.padding), "output shape");
        let mut emit = |out_row: usize, col: usize, sums: &[f32]| {
            let (image_idx, row) = (out_row / output_shape.height, out_row % output_shape.height);
            let first = output_shape.offset(image_idx, row, col) - span.start;
            apply_epilogue(
                sums.iter().copied(),
                &self.bias,
                &mut output[first..first + self.c_out],
                epilogue,
            );
        };
        match &self.weights {
            ConvWeights::Winograd(winograd) => {
                winograd.forward(input, input_shape, rows, &mut scratch.winograd, emit);
            }
            ConvWeights::Gemm(weights) => {
                self.gemm(weights, (input, input_shape), output_shape, rows, scratch, &mut emit);
            }
            ConvWeights::Int8(weights) => {
                let output = (output, output_shape, span.start);
                self.int8(weights, (input, input_shape), output, rows, epilogue, scratch);
            }
        }
    }

    fn gemm(
        &self,
        weights: &PackedWeights,
        (input, input_shape): (&[f32], FeatureMapShape),
        output_shape: FeatureMapShape,
        rows: Range<usize>,
        scratch: &mut ConvScratch,
        emit: &mut impl FnMut(usize, usize, &[f32]),
    ) {
        let FeatureMapShape { height, width, .. } = output_shape;
        if width >= MIN_IN_PLACE_WIDTH {
            let sums = &mut scratch.sums[..width * self.c_out];
            for out_row in rows {
                let image = &input[out_row / height * input_shape.image_len()..];
                self.sum_row(weights, image, input_shape, out_row % height, sums);
                for (col, sums) in sums.chunks_exact(self.c_out).enumerate() {
                    emit(out_row, col, sums);
                }
            }
            return;
        }
        let pixels = rows.start * width..rows.end * width;
        for start in pixels.clone().step_by(self.im2col_pixels()) {
            let n = self.im2col_pixels().min(pixels.end - start);
            let patches = &mut scratch.patches[..n * self.patch_len()];
            for (patch, pixel) in patches.chunks_exact_mut(self.patch_len()).zip(start..) {
                let (out_row, col) = (pixel / width, pixel % width);
                let image = &input[out_row / height * input_shape.image_len()..];
                self.copy_patch(image, input_shape, out_row % height, col, patch);
            }
            let sums = &mut scratch.sums[..n * self.c_out];
            weights.matmul(patches, self.patch_len(), sums, Accum::Replace);
            for (sums, pixel) in sums.chunks_exact(self.c_out).zip(start..) {
                emit(pixel / width, pixel % width, sums);
            }
        }
    }

    /// Computes the sums `[w, c_out]` of one output row, reading the overlapping windows in place.
    fn sum_row(
        &self,
        weights: &PackedWeights,
        image: &[f32],
        shape: FeatureMapShape,
        row: usize,
        sums: &mut [f32],
    ) {
        let inset = shape.padding - self.geometry.padding;
        let first = ((row * self.geometry.stride + inset) * shape.padded_width() + inset) * self.c_in;
        weights.matmul_segments(
            &image[first..],
            self.geometry.stride * self.c_in,
            self.window_rows(shape),
            sums,
        );
    }

    /// Returns the rows of a window in an input of this shape, as segments.
    fn window_rows(&self, shape: FeatureMapShape) -> Segments {
        let side = self.geometry.kernel_size;
        Segments { count: side, len: side * self.c_in, stride: shape.padded_width() * self.c_in }
    }

    /// Copies the window of an output pixel to `patch [kernel_size² · c_in]` (im2col).
    fn copy_patch(&self, image: &[f32], shape: FeatureMapShape, row: usize, col: usize, patch: &mut [f32]) {
        let inset = shape.padding - self.geometry.padding;
        let segment = self.geometry.kernel_size * self.c_in;
        let first_row = row * self.geometry.stride + inset;
        let first_col = col * self.geometry.stride + inset;
        for (kernel_row, part) in patch.chunks_exact_mut(segment).enumerate() {
            let from = ((first_row + kernel_row) * shape.padded_width() + first_col) * self.c_in;
            part.copy_from_slice(&image[from..from + segment]);
        }
    }

    /// Quantises the images of these rows, multiplies, and applies the epilogue. The output slice starts at
    /// offset `origin` of the feature maps.
    fn int8(
        &self,
        weights: &QuantisedWeights,
        (input, shape): (&[f32], FeatureMapShape),
        (output, output_shape, origin): (&mut [f32], FeatureMapShape, usize),
        rows: Range<usize>,
        epilogue: Epilogue,
        scratch: &mut ConvScratch,
    ) {
        let ConvScratch { quantised, scales, pixels, .. } = scratch;
        let FeatureMapShape { height, width, .. } = output_shape;
        let images = rows.start / height..rows.end.div_ceil(height);
        for (image_idx, scale) in images.clone().zip(&mut scales[images]) {
            let image = image_idx * shape.image_len()..(image_idx + 1) * shape.image_len();
            quantise_unsigned(&input[image.clone()], &mut quantised[image], scale);
        }
        let (inset, stride) = (shape.padding - self.geometry.padding, self.geometry.stride);
        pixels.clear();
        for out_row in rows {
            let (image_idx, row) = (out_row / height, out_row % height);
            let first = image_idx * shape.image_len()
                + ((row * stride + inset) * shape.padded_width() + inset) * self.c_in;
            pixels.extend((0..width).map(|col| OutputPixel {
                start: first + col * stride * self.c_in,
                out: output_shape.offset(image_idx, row, col) - origin,
                scale: scales[image_idx],
            }));
        }
        let segments = self.window_rows(shape);
        let start = |idx: usize| pixels[idx].start;
        weights.matmul(quantised, segments, pixels.len(), start, |idx, first, sums| {
            let OutputPixel { out, scale, .. } = pixels[idx];
            let columns = first..first + sums.len();
            let values = sums
                .iter()
                .zip(&weights.scales()[columns.clone()])
                .map(|(&sum, weight_scale)| sum as f32 * (scale * weight_scale));
            let out = &mut output[out + first..][..sums.len()];
            apply_epilogue(values, &self.bias[columns], out, epilogue);
        });
    }

    fn patch_len(&self) -> usize {
        self.geometry.kernel_size * self.geometry.kernel_size * self.c_in
    }

    fn im2col_pixels(&self) -> usize {
        (IM2COL_BLOCK_LEN / self.patch_len()).max(IM2COL_MIN_PIXELS)
    }
}

#[inline(always)]
fn apply_epilogue(sums: impl Iterator<Item = f32>, bias: &[f32], pixel: &mut [f32], epilogue: Epilogue) {
    let terms = pixel.iter_mut().zip(sums).zip(bias);
    match epilogue {
        Epilogue::Store => terms.for_each(|((y, x), b)| *y = x + b),
        Epilogue::Relu => terms.for_each(|((y, x), b)| *y = rectified(x + b)),
        Epilogue::AddRelu => terms.for_each(|((y, x), b)| *y = rectified(*y + (x + b))),
    }
}
