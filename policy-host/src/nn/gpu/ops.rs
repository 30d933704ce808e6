//! Layers as dispatches: one constructor per kernel, with the shapes of its tensors.
//!
//! Letters in shapes: `n` samples, `t` rows of a sample, `k` inputs, `d` model width, `c` channels.

use gpu::{DeviceBuffer, GpuDevice};

use super::kernel::{Dispatch, KernelCache, KernelSource};
pub use super::weights::DeviceWeights;
use crate::nn::conv::ConvGeometry;

/// Side of the tile of a product.
const TILE: usize = 64;
/// Threads of a workgroup of element-wise kernels.
pub(crate) const THREADS: usize = 256;
/// Words of workgroup memory that every device has.
const WORKGROUP_WORDS: usize = 4096;
/// Threads of a workgroup of the attention kernel, each with a partial result per query.
const ATTENTION_THREADS: usize = 64;
/// Largest number of queries that share a workgroup.
const MAX_QUERIES: usize = 8;

pub(crate) const BATCH: &str = include_str!("wgsl/batch.wgsl");
/// Sum over a workgroup of 64 threads.
pub(crate) const TOTAL: &str = include_str!("wgsl/total.wgsl");

/// The device, the compiled kernels, and the uniform buffer with the number of samples of a batch.
#[derive(Debug)]
pub struct OpBuilder<'a> {
    /// Device of all buffers.
    pub gpu: &'a GpuDevice,
    /// Kernels compiled so far.
    pub kernels: KernelCache,
    /// Number of samples of the batch.
    pub batch: &'a DeviceBuffer,
}

/// Writing of the sums of a product, bias included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProductEpilogue {
    /// `out = sum`.
    Store,
    /// `out = max(sum, 0)`.
    Relu,
    /// `out += sum`.
    Add,
    /// `out = max(out + sum, 0)`.
    AddRelu,
    /// `out = gelu(sum)`, in the form with tanh.
    Gelu,
    /// `out *= sum`.
    Multiply,
}

/// Code of the epilogue `out += gate · sum`, which takes the gate in place of the bias.
const GATED: usize = 6;

/// The rows of a sample in a buffer that a product reads or writes: `count` of its `of` rows, from `first`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleRows {
    /// Index of the first row.
    pub first: usize,
    /// Number of rows of a sample in the buffer.
    pub of: usize,
}

/// Feature maps of a sample: `[images, height, width, channels]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceMaps {
    /// Number of images of a sample.
    pub images: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of pixels in a row.
    pub width: usize,
    /// Number of channels.
    pub channels: usize,
}

/// Shape of an attention: queries `[n, n_queries, width]`, keys and values `[n, n_keys, width]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AttentionShape {
    /// Number of queries of a sample.
    pub n_queries: usize,
    /// Number of keys of a sample.
    pub n_keys: usize,
    /// Model width.
    pub width: usize,
    /// Number of heads.
    pub n_heads: usize,
    /// Key that only some samples have.
    pub optional_key: Option<usize>,
}

/// Source and target of the images of one camera.
#[derive(Clone, Copy, Debug)]
pub struct ImageSource<'a> {
    /// Bytes of all samples, each padded to whole words.
    pub bytes: &'a DeviceBuffer,
    /// Height and width of the source.
    pub from: [usize; 2],
    /// Normalised values `[3, 256]` of each byte.
    pub table: &'a DeviceBuffer,
    /// Filters of rows and columns, and their words per target pixel; `None` if the size stays.
    pub filters: Option<(&'a DeviceBuffer, usize)>,
    /// Index of the image among those of a sample in the target.
    pub image: usize,
}

impl SampleRows {
    /// Returns all rows of a sample.
    #[must_use]
    pub const fn all(of: usize) -> Self {
        Self { first: 0, of }
    }
}

impl DeviceMaps {
    /// Returns the number of values of a sample.
    #[must_use]
    pub const fn len(self) -> usize {
        self.images * self.height * self.width * self.channels
    }

    /// Returns `true` if there is no value.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Returns the number of pixels of a sample.
    #[must_use]
    pub const fn n_pixels(self) -> usize {
        self.images * self.height * self.width
    }

    /// Returns the maps after a convolution to `channels` channels.
    #[must_use]
    pub const fn convolved(self, geometry: ConvGeometry, channels: usize) -> Self {
        let (height, width) = (geometry.output_side(self.height), geometry.output_side(self.width));
        Self { height, width, channels, ..self }
    }
}

impl OpBuilder<'_> {
    /// Returns a linear layer for `n_rows` rows of each sample. With `positions [n_rows, k]`, those are added
    /// to the input first.
    pub fn linear(
        &mut self,
        layer: &DeviceWeights,
        n_rows: usize,
        (a, from, positions): (&DeviceBuffer, SampleRows, Option<&DeviceBuffer>),
        (out, to): (&DeviceBuffer, SampleRows),
        epilogue: ProductEpilogue,
    ) -> Dispatch {
        let rows = if positions.is_some() {
            include_str!("wgsl/product/positioned_rows.wgsl")
        } else {
            include_str!("wgsl/product/rows.wgsl")
        };
        let left = [("A_ROWS", from.of), ("A_FIRST", from.first)];
        let source = product(("linear", rows), layer, n_rows, &left, to, code(epilogue));
        let mut buffers = vec![self.batch, a, &layer.weights, &layer.bias, out];
        buffers.extend(positions);
        self.kernels.dispatch(self.gpu, source, &buffers, (n_rows, TILE), columns(layer))
    }

    /// Returns a linear layer without bias for all `n_rows` rows of each sample, which adds its products,
    /// multiplied by `gate [n]`, to `out`.
    pub fn gated_linear(
        &mut self,
        layer: &DeviceWeights,
        n_rows: usize,
        a: &DeviceBuffer,
        gate: &DeviceBuffer,
        out: &DeviceBuffer,
    ) -> Dispatch {
        let left = [("A_ROWS", n_rows), ("A_FIRST", 0)];
        let rows = ("gated_linear", include_str!("wgsl/product/rows.wgsl"));
        let source = product(rows, layer, n_rows, &left, SampleRows::all(n_rows), GATED);
        let buffers = [self.batch, a, &layer.weights, gate, out];
        self.kernels.dispatch(self.gpu, source, &buffers, (n_rows, TILE), columns(layer))
    }

    /// Returns a convolution of feature maps.
    pub fn conv(
        &mut self,
        layer: &DeviceWeights,
        geometry: ConvGeometry,
        (a, maps): (&DeviceBuffer, DeviceMaps),
        out: &DeviceBuffer,
        epilogue: ProductEpilogue,
    ) -> Dispatch {
        let output = maps.convolved(geometry, layer.n);
        let left = [
            ("HEIGHT", maps.height),
            ("WIDTH", maps.width),
            ("CHANNELS", maps.channels),
            ("OUT_HEIGHT", output.height),
            ("OUT_WIDTH", output.width),
            ("KERNEL", geometry.kernel_size),
            ("STRIDE", geometry.stride),
            ("PADDING", geometry.padding),
        ];
        let n_rows = output.n_pixels();
        let windows = ("convolution", include_str!("wgsl/product/windows.wgsl"));
        let source = product(windows, layer, n_rows, &left, SampleRows::all(n_rows), code(epilogue));
        let buffers = [self.batch, a, &layer.weights, &layer.bias, out];
        self.kernels.dispatch(self.gpu, source, &buffers, (n_rows, TILE), columns(layer))
    }

    /// Returns a layer normalisation of `n_rows` rows of each sample, in place.
    pub fn layer_norm(
        &mut self,
        (weight, bias): (&DeviceBuffer, &DeviceBuffer),
        (n_rows, width): (usize, usize),
        x: &DeviceBuffer,
    ) -> Dispatch {
        let parts = &[TOTAL, include_str!("wgsl/layer_norm.wgsl")];
        let source = kernel("layer_norm", parts, &[("WIDTH", width)]);
        // The kernel needs no guard against further rows: a workgroup takes one.
        self.kernels.dispatch(self.gpu, source, &[weight, bias, x], (n_rows, 1), [1, 1])
    }

    /// Returns an attention. `present [n] u32` tells which samples have the optional key. Returns `None` if
    /// the scores of a query exceed the memory of a workgroup.
    pub fn attention(
        &mut self,
        shape: AttentionShape,
        [queries, keys, values]: [&DeviceBuffer; 3],
        present: &DeviceBuffer,
        out: &DeviceBuffer,
    ) -> Option<Dispatch> {
        let AttentionShape { n_queries, n_keys, width, n_heads, optional_key } = shape;
        let fit = WORKGROUP_WORDS / (n_keys + ATTENTION_THREADS);
        let block = n_queries.min(fit).min(MAX_QUERIES);
        if block == 0 {
            return None;
        }
        let constants = [
            ("N_QUERIES", n_queries),
            ("N_KEYS", n_keys),
            ("WIDTH", width),
            ("HEAD", width / n_heads),
            ("QUERIES", block),
            ("OPTIONAL", optional_key.unwrap_or(n_keys)),
        ];
        let source = kernel("attention", &[include_str!("wgsl/attention.wgsl")], &constants);
        let buffers = [queries, keys, values, present, out];
        let items = (n_queries.div_ceil(block), 1);
        Some(self.kernels.dispatch(self.gpu, source, &buffers, items, [n_heads as u32, 1]))
    }

    /// Returns the pooling of feature maps by maxima of 3 × 3 pixels, with stride 2 and padding 1.
    pub fn max_pool(&mut self, (a, maps): (&DeviceBuffer, DeviceMaps), out: &DeviceBuffer) -> Dispatch {
        let DeviceMaps { images, height, width, channels } = maps;
        let n_items = images * height.div_ceil(2) * width.div_ceil(2) * channels;
        let constants = [("ITEMS", n_items), ("HEIGHT", height), ("WIDTH", width), ("CHANNELS", channels)];
        let source = kernel("max_pool", &[BATCH, include_str!("wgsl/max_pool.wgsl")], &constants);
        self.kernels.dispatch(self.gpu, source, &[self.batch, a, out], (n_items, THREADS), [1, 1])
    }

    /// Returns the conversion of a camera's images to the first layer's input, `maps` with 3 channels.
    pub fn image(&mut self, camera: ImageSource<'_>, maps: DeviceMaps, out: &DeviceBuffer) -> Dispatch {
        let [from_height, from_width] = camera.from;
        let constants = [
            ("HEIGHT", maps.height),
            ("WIDTH", maps.width),
            ("FROM_WIDTH", from_width),
            ("FROM_WORDS", (from_height * from_width * 3).div_ceil(4)),
            ("OUT_IMAGES", maps.images),
            ("OUT_IMAGE", camera.image),
            ("TAPS", camera.filters.map_or(0, |(_, n_words)| n_words)),
            ("RESIZES", usize::from(camera.filters.is_some())),
        ];
        let source = kernel("image", &[BATCH, include_str!("wgsl/image.wgsl")], &constants);
        // Without filters, the kernel does not read the binding.
        let filters = camera.filters.map_or(camera.table, |(filters, _)| filters);
        let buffers = [self.batch, camera.bytes, camera.table, filters, out];
        let items = (maps.height * maps.width, THREADS);
        self.kernels.dispatch(self.gpu, source, &buffers, items, [1, 1])
    }
}

/// Returns the source of a product with the left factor of the WGSL source `rows`.
fn product(
    (name, rows): (&'static str, &'static str),
    layer: &DeviceWeights,
    n_rows: usize,
    left: &[(&'static str, usize)],
    to: SampleRows,
    epilogue: usize,
) -> KernelSource {
    let right = [("K", layer.k), ("N", layer.n)];
    let out = [("ROWS", n_rows), ("OUT_ROWS", to.of), ("OUT_FIRST", to.first), ("EPILOGUE", epilogue)];
    let (weights, format) = layer.layout.source();
    let constants = [&right[..], left, &out, format].concat();
    let product = include_str!("wgsl/product/product.wgsl");
    kernel(name, &[BATCH, rows, weights, include_str!("wgsl/product/epilogue.wgsl"), product], &constants)
}

const fn code(epilogue: ProductEpilogue) -> usize {
    match epilogue {
        ProductEpilogue::Store => 0,
        ProductEpilogue::Relu => 1,
        ProductEpilogue::Add => 2,
        ProductEpilogue::AddRelu => 3,
        ProductEpilogue::Gelu => 4,
        ProductEpilogue::Multiply => 5,
    }
}

/// Returns the workgroups along the columns of a product.
fn columns(layer: &DeviceWeights) -> [u32; 2] {
    [layer.n.div_ceil(TILE) as u32, 1]
}

pub(crate) fn kernel(
    name: &'static str,
    parts: &[&'static str],
    constants: &[(&'static str, usize)],
) -> KernelSource {
    let constants = constants.iter().map(|(name, value)| (*name, *value as u32)).collect();
    KernelSource { name, parts: parts.to_vec(), constants }
}
