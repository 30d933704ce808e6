//! 2-D convolutions of feature maps, with the batch normalisation that follows folded in.
//!
//! Two ways, chosen by shape alone:
//! - *shifted*: a 3×3 kernel of stride 1 over a bordered map is three products whose left factor is the map itself,
//!   read as overlapping rows of three pixels. Nothing is copied; the product also computes the two border columns of
//!   every row, which are cleared afterwards.
//! - *unfolded*: patches are copied into stripes and multiplied; for strides, other kernels, and maps so small that the
//!   wasted columns would cost more than the copy.

use super::maps::MapShape;
use super::matmul::{Into, multiply, view, view_mut};

/// Smallest map for which the wasted border columns cost less than copying patches.
const SHIFTED_MIN_SIDE: usize = 14;
/// Pixels of a shifted stripe: enough rows to amortise the packing of the weights, few enough to stay in cache.
const SHIFTED_STRIPE_PIXELS: usize = 812;
/// Numbers in a stripe of patches: half a mebibyte, so that it stays in the second-level cache.
const PATCH_STRIPE_LEN: usize = 1 << 17;
/// Fewest pixels in a stripe of patches, so that packing the weights for each stripe stays cheap.
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
    /// `[kernel, kernel, C_in, C_out]`.
    matrix: Vec<f32>,
    bias: Vec<f32>,
    window: Window,
    c_in: usize,
    c_out: usize,
}

/// Working memory of convolutions.
#[derive(Clone, Debug, Default)]
pub struct ConvScratch {
    patches: Vec<f32>,
    sums: Vec<f32>,
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
        Self { matrix, bias, window, c_in, c_out }
    }

    /// Shape of the output, with a border of `border` pixels.
    #[must_use]
    pub fn output_shape(&self, input: MapShape, border: usize) -> MapShape {
        MapShape { side: self.window.output_side(input.side), channels: self.c_out, border, ..input }
    }

    /// Lets `scratch` grow to what [`run`](Self::run) needs for this input.
    pub fn reserve(&self, input: MapShape, scratch: &mut ConvScratch) {
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
        let shifted = self.window == Window { kernel: 3, stride: 1, padding: 1 }
            && (input_shape.border, output_shape.border) == (1, 1)
            && input_shape.side >= SHIFTED_MIN_SIDE;
        if shifted {
            let maps = input.chunks_exact(input_shape.map_len());
            for (from, to) in maps.zip(output.chunks_exact_mut(output_shape.map_len())) {
                self.shifted_map(from, to, input_shape, finish);
            }
        } else {
            self.unfolded(input, input_shape, output, output_shape, finish, scratch);
        }
        output_shape.clear_border(output);
    }

    /// One bordered map. The product over pixel `i` of the input (border included, row by row) has its window's centre
    /// one row and one column further, which is where the output's pixel lies, so both sides run through memory evenly.
    fn shifted_map(&self, from: &[f32], to: &mut [f32], shape: MapShape, finish: Finish) {
        let (pitch, c_in, c_out) = (shape.pitch(), self.c_in, self.c_out);
        let n_pixels = shape.side * pitch - 2;
        let stripe = (SHIFTED_STRIPE_PIXELS / pitch).max(1) * pitch;
        let weights_of_row = 3 * c_in * c_out;
        let mut start = 0;
        while start < n_pixels {
            let n = stripe.min(n_pixels - start);
            let first = (start + pitch + 1) * c_out;
            let out = &mut to[first..first + n * c_out];
            for kernel_row in 0..3 {
                let replace = kernel_row == 0 && finish != Finish::AddRelu;
                multiply(
                    view_mut(out, n, c_out, c_out),
                    if replace { Into::Replace } else { Into::Add },
                    view(&from[(start + kernel_row * pitch) * c_in..], n, 3 * c_in, c_in),
                    view(&self.matrix[kernel_row * weights_of_row..], 3 * c_in, c_out, c_out),
                );
            }
            self.finish_in_place(out, finish);
            start += n;
        }
    }

    fn finish_in_place(&self, out: &mut [f32], finish: Finish) {
        let floor = if finish == Finish::Store { f32::NEG_INFINITY } else { 0.0 };
        for pixel in out.chunks_exact_mut(self.c_out) {
            pixel.iter_mut().zip(&self.bias).for_each(|(y, b)| *y = (*y + b).max(floor));
        }
    }

    fn unfolded(
        &self,
        input: &[f32],
        input_shape: MapShape,
        output: &mut [f32],
        output_shape: MapShape,
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
            multiply(
                view_mut(sums, n, self.c_out, self.c_out),
                Into::Replace,
                view(patches, n, self.patch_len(), self.patch_len()),
                view(&self.matrix, self.patch_len(), self.c_out, self.c_out),
            );
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
