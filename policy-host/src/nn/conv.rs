//! 2-D convolutions of feature maps, with the batch normalisation that follows folded in.
//!
//! Two ways, chosen by the window alone: 3×3 kernels of stride 1 go by way of [`winograd`](super::winograd); for others,
//! patches are copied into stripes and multiplied.

use super::maps::MapShape;
use super::matmul::Into;
use super::packed::Packed;
use super::winograd::{LANES, Winograd, WinogradScratch};

/// Numbers in a stripe of patches: half a mebibyte, so that it stays in the second-level cache.
const PATCH_STRIPE_LEN: usize = 1 << 17;
/// Fewest pixels in a stripe of patches, so that reading the weights for each stripe stays cheap.
const PATCH_STRIPE_MIN_PIXELS: usize = 256;

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
}

/// Working memory of convolutions.
#[derive(Clone, Debug, Default)]
pub struct ConvScratch {
    patches: Vec<f32>,
    sums: Vec<f32>,
    winograd: WinogradScratch,
}

impl Conv {
    /// A convolution of `weight [C_out, C_in, kernel, kernel]` without bias, followed by `norm`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    #[must_use]
    pub fn folded(weight: &[f32], norm: FrozenNorm<'_>, window: Window) -> Self {
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
        let kernels = if whole_lanes && window == (Window { kernel: 3, stride: 1, padding: 1 }) {
            Kernels::Winograd(Winograd::new(&matrix, c_in, c_out))
        } else {
            Kernels::Unfolded(Packed::new(&matrix, area * c_in, c_out))
        };
        Self { kernels, bias, window, c_in, c_out }
    }

    /// Shape of the output, with a border of `border` pixels.
    #[must_use]
    pub fn output_shape(&self, input: MapShape, border: usize) -> MapShape {
        MapShape { side: self.window.output_side(input.side), channels: self.c_out, border, ..input }
    }

    /// Lets `scratch` grow to what [`run`](Self::run) needs for this input.
    pub fn reserve(&self, input: MapShape, scratch: &mut ConvScratch) {
        if let Kernels::Winograd(winograd) = &self.kernels {
            return winograd.reserve(input, &mut scratch.winograd);
        }
        let side = self.window.output_side(input.side);
        let n_pixels = self.stripe_pixels().min(input.n_maps * side * side);
        let grow = |buffer: &mut Vec<f32>, len: usize| buffer.resize(buffer.len().max(len), 0.0);
        grow(&mut scratch.patches, n_pixels * self.patch_len());
        grow(&mut scratch.sums, n_pixels * self.c_out);
    }

    /// Convolves `input` (its border at least the padding wide) into `output`, whose border is zero afterwards.
    ///
    /// # Panics
    /// If a slice does not have its shape, or `scratch` was not reserved for this shape.
    pub fn run(
        &self,
        (input, input_shape): (&[f32], MapShape),
        (output, output_shape): (&mut [f32], MapShape),
        finish: Finish,
        scratch: &mut ConvScratch,
    ) {
        assert_eq!(input.len(), input_shape.len(), "input {input_shape:?}");
        assert_eq!(output.len(), output_shape.len(), "output {output_shape:?}");
        assert_eq!(input_shape.channels, self.c_in, "input channels");
        assert!(input_shape.border >= self.window.padding, "the border holds the padding");
        assert_eq!(output_shape, self.output_shape(input_shape, output_shape.border), "output shape");
        match &self.kernels {
            Kernels::Winograd(winograd) => {
                winograd.run(input, input_shape, &mut scratch.winograd, |map_idx, row, col, sums| {
                    let first = output_shape.offset(map_idx, row, col);
                    self.finish_pixel(sums, &mut output[first..first + self.c_out], finish);
                });
            }
            Kernels::Unfolded(matrix) => {
                self.unfolded(matrix, (input, input_shape), (output, output_shape), finish, scratch);
            }
        }
        output_shape.clear_border(output);
    }

    fn unfolded(
        &self,
        matrix: &Packed,
        (input, input_shape): (&[f32], MapShape),
        (output, output_shape): (&mut [f32], MapShape),
        finish: Finish,
        scratch: &mut ConvScratch,
    ) {
        let side = output_shape.side;
        let n_pixels = output_shape.n_maps * side * side;
        let place = |pixel: usize| (pixel / (side * side), pixel / side % side, pixel % side);
        let mut start = 0;
        while start < n_pixels {
            let n = self.stripe_pixels().min(n_pixels - start);
            let patches = &mut scratch.patches[..n * self.patch_len()];
            for (idx, patch) in patches.chunks_exact_mut(self.patch_len()).enumerate() {
                let (map_idx, row, col) = place(start + idx);
                self.copy_patch(&input[map_idx * input_shape.map_len()..], input_shape, row, col, patch);
            }
            let sums = &mut scratch.sums[..n * self.c_out];
            matrix.run(patches, self.patch_len(), sums, Into::Replace);
            for (idx, sums) in sums.chunks_exact(self.c_out).enumerate() {
                let (map_idx, row, col) = place(start + idx);
                let first = output_shape.offset(map_idx, row, col);
                self.finish_pixel(sums, &mut output[first..first + self.c_out], finish);
            }
            start += n;
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

    fn finish_pixel(&self, sums: &[f32], pixel: &mut [f32], finish: Finish) {
        let terms = pixel.iter_mut().zip(sums).zip(&self.bias);
        match finish {
            Finish::Store => terms.for_each(|((y, x), b)| *y = x + b),
            Finish::Relu => terms.for_each(|((y, x), b)| *y = (x + b).max(0.0)),
            Finish::AddRelu => terms.for_each(|((y, x), b)| *y = (*y + (x + b)).max(0.0)),
        }
    }

    fn patch_len(&self) -> usize {
        self.window.kernel * self.window.kernel * self.c_in
    }

    fn stripe_pixels(&self) -> usize {
        (PATCH_STRIPE_LEN / self.patch_len()).max(PATCH_STRIPE_MIN_PIXELS)
    }
}
