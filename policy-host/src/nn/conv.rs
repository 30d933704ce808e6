//! 2-D convolutions of feature maps, with the batch normalisation that follows folded in.
//!
//! 3×3 kernels of stride 1 go by way of [`winograd`](super::winograd). For others the windows of an output line are
//! multiplied where they lie, a kernel row at a time, or, where lines are short, copied into stripes of patches first. Each sum
//! is the same chain of additions either way. In eight bits all windows are multiplied where they lie.

use std::ops::Range;

use super::Precision;
use super::maps::MapShape;
use super::matmul::Into;
use super::packed::Packed;
use super::quantised::{QUAD, QuantisedMatrix, Runs, quantise_positive};
use super::winograd::{LANES, Winograd, WinogradScratch};

/// Numbers in a stripe of patches: half a mebibyte, so that it stays in the second-level cache.
const PATCH_STRIPE_LEN: usize = 1 << 17;
/// Fewest pixels in a stripe of patches, so that reading the weights for each stripe stays cheap.
const PATCH_STRIPE_MIN_PIXELS: usize = 256;

/// Shortest output line whose windows are multiplied where they lie: the weights are read once for each line.
const LONG_LINE: usize = 24;

/// Size of the kernel and its step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Side of the kernel in pixels.
    pub kernel: usize,
    /// Pixels between the centres of neighbouring windows.
    pub stride: usize,
    /// Zero pixels assumed around the input.
    pub padding: usize,
}

impl Window {
    /// Side of the output for an input of `side` pixels.
    #[must_use]
    pub const fn output_side(self, side: usize) -> usize {
        (side + 2 * self.padding - self.kernel) / self.stride + 1
    }
}

/// A batch normalisation of fixed statistics, `[C] f32` each.
#[derive(Clone, Copy, Debug)]
pub struct FrozenNorm<'a> {
    /// Scale.
    pub weight: &'a [f32],
    /// Offset.
    pub bias: &'a [f32],
    /// Mean subtracted.
    pub mean: &'a [f32],
    /// Variance divided by, before the root.
    pub variance: &'a [f32],
}

impl FrozenNorm<'_> {
    /// Added to the variance (torchvision's FrozenBatchNorm2d and the benchmark's copy of it).
    pub const EPSILON: f32 = 1e-5;
}

/// What happens to the sums of a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// They overwrite the output.
    Store,
    /// Their positive part overwrites the output.
    Relu,
    /// They are added to the output, and the positive part stays: the end of a residual block.
    AddRelu,
}

/// A convolution with bias.
#[derive(Clone, Debug)]
pub struct Conv {
    kernels: Kernels,
    bias: Vec<f32>,
    window: Window,
    c_in: usize,
    c_out: usize,
}

#[derive(Clone, Debug)]
enum Kernels {
    Winograd(Winograd),
    /// `[kernel · kernel · C_in, C_out]`.
    Unfolded(Packed),
    /// As above.
    Quantised(QuantisedMatrix),
}

/// Working memory of convolutions.
#[derive(Clone, Debug, Default)]
pub struct ConvScratch {
    patches: Vec<f32>,
    sums: Vec<f32>,
    winograd: WinogradScratch,
    /// The rounded input.
    rounded: Vec<u8>,
    /// What a step of each rounded map is worth.
    steps: Vec<f32>,
    /// The pixels that are computed.
    pixels: Vec<Pixel>,
}

/// An output pixel of a convolution in eight bits.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    /// Where its window begins in the input.
    start: usize,
    /// Where it lies in the output.
    out: usize,
    /// What a step of its map is worth.
    step: f32,
}

impl Conv {
    /// A convolution of `weight [C_out, C_in, kernel, kernel]` without bias, followed by `norm`. In eight bits its input must
    /// not be negative.
    ///
    /// # Panics
    /// If the lengths do not fit.
    #[must_use]
    pub fn folded(weight: &[f32], norm: FrozenNorm<'_>, window: Window, precision: Precision) -> Self {
        let c_out = norm.weight.len();
        let area = window.kernel * window.kernel;
        let c_in = weight.len() / (c_out * area);
        assert_eq!(weight.len(), c_out * c_in * area, "kernels [{c_out}, {c_in}, {area}]");
        let mut matrix = vec![0.0; weight.len()];
        let mut bias = vec![0.0; c_out];
        for out_idx in 0..c_out {
            let scale = norm.weight[out_idx] / (norm.variance[out_idx] + FrozenNorm::EPSILON).sqrt();
            bias[out_idx] = norm.bias[out_idx] - norm.mean[out_idx] * scale;
            for in_idx in 0..c_in {
                for tap in 0..area {
                    let x = weight[(out_idx * c_in + in_idx) * area + tap];
                    matrix[(tap * c_in + in_idx) * c_out + out_idx] = x * scale;
                }
            }
        }
        let whole_lanes = c_in.is_multiple_of(LANES) && c_out.is_multiple_of(LANES);
        let kernels = if precision == Precision::Int8 && c_in.is_multiple_of(QUAD) {
            Kernels::Quantised(QuantisedMatrix::new(&matrix, area * c_in, c_out))
        } else if whole_lanes && window == (Window { kernel: 3, stride: 1, padding: 1 }) {
            Kernels::Winograd(Winograd::new(&matrix, c_in, c_out))
        } else {
            Kernels::Unfolded(Packed::new(&matrix, area * c_in, c_out))
        };
        Self { kernels, bias, window, c_in, c_out }
    }

    /// Lines of output that are best computed together: bands are cut at multiples of it.
    #[must_use]
    pub fn lines_together(&self) -> usize {
        match &self.kernels {
            Kernels::Winograd(winograd) => winograd.out_side(),
            Kernels::Unfolded(_) | Kernels::Quantised(_) => 1,
        }
    }

    /// Shape of the output, with a border of `border` pixels.
    #[must_use]
    pub fn output_shape(&self, input: MapShape, border: usize) -> MapShape {
        let [height, width] = [input.height, input.width].map(|side| self.window.output_side(side));
        MapShape { height, width, channels: self.c_out, border, ..input }
    }

    /// Lets `scratch` grow to what [`run`](Self::run) needs for this input.
    pub fn reserve(&self, input: MapShape, scratch: &mut ConvScratch) {
        let output = self.output_shape(input, 0);
        match &self.kernels {
            Kernels::Winograd(winograd) => return winograd.reserve(input, &mut scratch.winograd),
            Kernels::Quantised(_) => {
                scratch.rounded.resize(scratch.rounded.len().max(input.len()), 0);
                scratch.steps.resize(scratch.steps.len().max(input.n_maps), 0.0);
                return scratch.pixels.reserve(output.n_lines() * output.width);
            }
            Kernels::Unfolded(_) => {}
        }
        if output.width >= LONG_LINE {
            return scratch.sums.resize(scratch.sums.len().max(output.width * self.c_out), 0.0);
        }
        let n_pixels = self.stripe_pixels().min(output.n_maps * output.height * output.width);
        let grow = |buffer: &mut Vec<f32>, len: usize| buffer.resize(buffer.len().max(len), 0.0);
        grow(&mut scratch.patches, n_pixels * self.patch_len());
        grow(&mut scratch.sums, n_pixels * self.c_out);
    }

    /// Convolves `input` (its border at least the padding wide) into these lines of the output: `output` is the memory of
    /// the lines ([`MapShape::lines`]), whose border is left alone.
    ///
    /// # Panics
    /// If a slice does not have its shape, or `scratch` was not reserved for this shape.
    pub fn run(
        &self,
        (input, input_shape): (&[f32], MapShape),
        (output, output_shape): (&mut [f32], MapShape),
        lines: Range<usize>,
        finish: Finish,
        scratch: &mut ConvScratch,
    ) {
        assert_eq!(input.len(), input_shape.len(), "input {input_shape:?}");
        let memory = output_shape.lines(lines.clone());
        assert_eq!(output.len(), memory.len(), "lines {lines:?} of {output_shape:?}");
        assert_eq!(input_shape.channels, self.c_in, "input channels");
        assert!(input_shape.border >= self.window.padding, "the border holds the padding");
        assert_eq!(output_shape, self.output_shape(input_shape, output_shape.border), "output shape");
        let mut take = |line: usize, col: usize, sums: &[f32]| {
            let (map_idx, row) = (line / output_shape.height, line % output_shape.height);
            let first = output_shape.offset(map_idx, row, col) - memory.start;
            finish_pixel(sums.iter().copied(), &self.bias, &mut output[first..first + self.c_out], finish);
        };
        match &self.kernels {
            Kernels::Winograd(winograd) => {
                winograd.run(input, input_shape, lines, &mut scratch.winograd, take);
            }
            Kernels::Unfolded(matrix) => {
                self.unfolded(matrix, (input, input_shape), output_shape, lines, scratch, &mut take);
            }
            Kernels::Quantised(matrix) => {
                let output = (output, output_shape, memory.start);
                self.quantised(matrix, (input, input_shape), output, lines, finish, scratch);
            }
        }
    }

    fn unfolded(
        &self,
        matrix: &Packed,
        (input, input_shape): (&[f32], MapShape),
        output_shape: MapShape,
        lines: Range<usize>,
        scratch: &mut ConvScratch,
        take: &mut impl FnMut(usize, usize, &[f32]),
    ) {
        let MapShape { height, width, .. } = output_shape;
        if width >= LONG_LINE {
            let sums = &mut scratch.sums[..width * self.c_out];
            for line in lines {
                let map = &input[line / height * input_shape.map_len()..];
                self.sum_line(matrix, map, input_shape, line % height, sums);
                for (col, sums) in sums.chunks_exact(self.c_out).enumerate() {
                    take(line, col, sums);
                }
            }
            return;
        }
        let pixels = lines.start * width..lines.end * width;
        for start in pixels.clone().step_by(self.stripe_pixels()) {
            let n = self.stripe_pixels().min(pixels.end - start);
            let patches = &mut scratch.patches[..n * self.patch_len()];
            for (patch, pixel) in patches.chunks_exact_mut(self.patch_len()).zip(start..) {
                let (line, col) = (pixel / width, pixel % width);
                let map = &input[line / height * input_shape.map_len()..];
                self.copy_patch(map, input_shape, line % height, col, patch);
            }
            let sums = &mut scratch.sums[..n * self.c_out];
            matrix.run(patches, self.patch_len(), sums, Into::Replace);
            for (sums, pixel) in sums.chunks_exact(self.c_out).zip(start..) {
                take(pixel / width, pixel % width, sums);
            }
        }
    }

    /// The sums of one output line, from windows that overlap in the input.
    fn sum_line(&self, matrix: &Packed, map: &[f32], shape: MapShape, row: usize, sums: &mut [f32]) {
        let run = self.window.kernel * self.c_in;
        let inset = shape.border - self.window.padding;
        for kernel_row in 0..self.window.kernel {
            let first = ((row * self.window.stride + inset + kernel_row) * shape.pitch() + inset) * self.c_in;
            let into = if kernel_row == 0 { Into::Replace } else { Into::Add };
            let part = kernel_row * run..(kernel_row + 1) * run;
            matrix.run_part(part, &map[first..], self.window.stride * self.c_in, sums, into);
        }
    }

    fn copy_patch(&self, map: &[f32], shape: MapShape, row: usize, col: usize, patch: &mut [f32]) {
        let inset = shape.border - self.window.padding;
        let run = self.window.kernel * self.c_in;
        let first_row = row * self.window.stride + inset;
        let first_col = col * self.window.stride + inset;
        for (kernel_row, part) in patch.chunks_exact_mut(run).enumerate() {
            let from = ((first_row + kernel_row) * shape.pitch() + first_col) * self.c_in;
            part.copy_from_slice(&map[from..from + run]);
        }
    }

    /// Rounds the maps that these lines see, multiplies, and finishes the sums; the output's memory begins at `origin`.
    fn quantised(
        &self,
        matrix: &QuantisedMatrix,
        (input, shape): (&[f32], MapShape),
        (output, output_shape, origin): (&mut [f32], MapShape, usize),
        lines: Range<usize>,
        finish: Finish,
        scratch: &mut ConvScratch,
    ) {
        let ConvScratch { rounded, steps, pixels, .. } = scratch;
        let MapShape { height, width, .. } = output_shape;
        let maps = lines.start / height..lines.end.div_ceil(height);
        for (map_idx, step) in maps.clone().zip(&mut steps[maps]) {
            let map = map_idx * shape.map_len()..(map_idx + 1) * shape.map_len();
            quantise_positive(&input[map.clone()], &mut rounded[map], step);
        }
        let (inset, stride) = (shape.border - self.window.padding, self.window.stride);
        pixels.clear();
        for line in lines {
            let (map_idx, row) = (line / height, line % height);
            let first =
                map_idx * shape.map_len() + ((row * stride + inset) * shape.pitch() + inset) * self.c_in;
            pixels.extend((0..width).map(|col| Pixel {
                start: first + col * stride * self.c_in,
                out: output_shape.offset(map_idx, row, col) - origin,
                step: steps[map_idx],
            }));
        }
        let side = self.window.kernel;
        let runs = Runs { count: side, len: side * self.c_in, stride: shape.pitch() * self.c_in };
        let start = |idx: usize| pixels[idx].start;
        matrix.run(rounded, runs, pixels.len(), start, |idx, first, sums| {
            let Pixel { out, step, .. } = pixels[idx];
            let columns = first..first + sums.len();
            let values = sums
                .iter()
                .zip(&matrix.steps()[columns.clone()])
                .map(|(&sum, own)| sum as f32 * (step * own));
            let out = &mut output[out + first..][..sums.len()];
            finish_pixel(values, &self.bias[columns], out, finish);
        });
    }

    fn patch_len(&self) -> usize {
        self.window.kernel * self.window.kernel * self.c_in
    }

    fn stripe_pixels(&self) -> usize {
        (PATCH_STRIPE_LEN / self.patch_len()).max(PATCH_STRIPE_MIN_PIXELS)
    }
}

#[inline(always)]
fn finish_pixel(sums: impl Iterator<Item = f32>, bias: &[f32], pixel: &mut [f32], finish: Finish) {
    let terms = pixel.iter_mut().zip(sums).zip(bias);
    match finish {
        Finish::Store => terms.for_each(|((y, x), b)| *y = x + b),
        Finish::Relu => terms.for_each(|((y, x), b)| *y = (x + b).max(0.0)),
        Finish::AddRelu => terms.for_each(|((y, x), b)| *y = (*y + (x + b)).max(0.0)),
    }
}
