//! Layers for sequences of different lengths, whose rows follow each other without padding: one constructor
//! per kernel.
//!
//! Their batch counts rows or sequences, as the caller decides with [`OpBuilder::batch`].

use gpu::DeviceBuffer;

use super::kernel::Dispatch;
use super::ops::{BATCH, OpBuilder, THREADS, TOTAL, kernel};

/// Largest width of a head that attention supports.
pub const MAX_HEAD_WIDTH: usize = 256;
/// Queries, or keys, of a block of attention.
const BLOCK: usize = 32;

/// Kind of normalisation, with the term added to a variance or mean square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowNorm {
    /// Layer normalisation.
    Layer(f32),
    /// RMS normalisation.
    Rms(f32),
}

/// Rows whose heads are turned by their positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RotaryRows {
    /// Rows per unit of the batch.
    pub n_rows: usize,
    /// Values of a row.
    pub stride: usize,
    /// Heads of a row that are turned, from its start.
    pub n_heads: usize,
    /// Width of a head.
    pub head_width: usize,
}

/// Rows of a sample in the buffers of an attention, as the kernel reads them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SequenceSpan {
    /// First row of its queries.
    pub first_query: u32,
    /// Number of rows of queries.
    pub n_queries: u32,
    /// First row of its keys and values.
    pub first_key: u32,
    /// Number of rows of keys and values.
    pub n_keys: u32,
}

/// Shape of an attention over sequences: queries `[t, n_heads · head_width]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequenceShape {
    /// Number of query heads.
    pub n_heads: usize,
    /// Width of a head.
    pub head_width: usize,
    /// `true` if all heads share keys and values.
    pub shares_keys: bool,
    /// Largest number of query rows of a sample.
    pub max_queries: usize,
    /// Rows per sample of the second buffer of keys and values; 0 if there is none.
    pub suffix: usize,
}

/// Buffers of an attention over sequences. A row of keys and values holds the keys of all heads, then their
/// values.
#[derive(Clone, Copy, Debug)]
pub struct SequenceInput<'a> {
    /// Queries `[t, n_heads · head_width]`.
    pub queries: &'a DeviceBuffer,
    /// Keys and values of the sequences.
    pub prefix: &'a DeviceBuffer,
    /// Further keys and values, the same number for every sample; any buffer if there is none.
    pub suffix: &'a DeviceBuffer,
    /// A [`SequenceSpan`] per sample.
    pub spans: &'a DeviceBuffer,
}

impl OpBuilder<'_> {
    /// Returns a normalisation of `n_rows` rows of each unit of the batch from `x` to `out`, with
    /// `scale [width]` and `shift [width]`.
    pub fn normalise(
        &mut self,
        norm: RowNorm,
        (n_rows, width): (usize, usize),
        x: &DeviceBuffer,
        (scale, shift): (&DeviceBuffer, &DeviceBuffer),
        out: &DeviceBuffer,
    ) -> Dispatch {
        let (centres, epsilon) = match norm {
            RowNorm::Layer(epsilon) => (1, epsilon),
            RowNorm::Rms(epsilon) => (0, epsilon),
        };
        let constants = [("WIDTH", width), ("CENTRES", centres), ("EPSILON", epsilon.to_bits() as usize)];
        let source = kernel("normalise", &[TOTAL, include_str!("wgsl/normalise.wgsl")], &constants);
        self.kernels.dispatch(self.gpu, source, &[x, scale, shift, out], (n_rows, 1), [1, 1])
    }

    /// Returns the rotation of heads by their positions, in place. `angles [positions, head_width / 2]` are
    /// pairs of cosine and sine, `positions [t] u32` those of the rows.
    pub fn rotate(
        &mut self,
        rows: RotaryRows,
        (angles, positions): (&DeviceBuffer, &DeviceBuffer),
        x: &DeviceBuffer,
    ) -> Dispatch {
        let RotaryRows { n_rows, stride, n_heads, head_width } = rows;
        let constants = [("ROWS", n_rows), ("STRIDE", stride), ("HEADS", n_heads), ("HALF", head_width / 2)];
        let source = kernel("rotary", &[BATCH, include_str!("wgsl/rotary.wgsl")], &constants);
        let items = (n_rows * n_heads * head_width / 2, THREADS);
        self.kernels.dispatch(self.gpu, source, &[self.batch, angles, positions, x], items, [1, 1])
    }

    /// Returns an attention without a mask: every query of a sample attends to all keys of the sample. The
    /// batch counts samples. Returns `None` if the heads are too wide.
    pub fn sequence_attention(
        &mut self,
        shape: SequenceShape,
        input: SequenceInput<'_>,
        out: &DeviceBuffer,
    ) -> Option<Dispatch> {
        let SequenceShape { n_heads, head_width, shares_keys, max_queries, suffix } = shape;
        if head_width > MAX_HEAD_WIDTH {
            return None;
        }
        let width = n_heads * head_width;
        // Heads that share their keys are further queries of one head.
        let (group, query_stride, key_width, key_step, key_heads) = if shares_keys {
            (n_heads, head_width, head_width, 0, 1)
        } else {
            (1, width, width, head_width, n_heads)
        };
        let n_blocks = (max_queries * group).div_ceil(BLOCK);
        let constants = [
            ("HEAD", head_width),
            ("GROUP", group),
            ("QUERY_STRIDE", query_stride),
            ("KEY_STRIDE", 2 * key_width),
            ("VALUES", key_width),
            ("KEY_STEP", key_step),
            ("BLOCKS", n_blocks),
            ("SUFFIX", suffix),
        ];
        let source =
            kernel("sequence_attention", &[include_str!("wgsl/sequence_attention.wgsl")], &constants);
        let buffers = [input.queries, input.prefix, input.suffix, input.spans, out];
        Some(self.kernels.dispatch(self.gpu, source, &buffers, (n_blocks, 1), [key_heads as u32, 1]))
    }

    /// Returns the gathering of rows `[width]` from two tables, one row per unit of the batch: row `i` is row
    /// `index[i] / 2` of the first table, or of the second one if `index[i]` is odd.
    pub fn gather(
        &mut self,
        width: usize,
        [first, second]: [&DeviceBuffer; 2],
        index: &DeviceBuffer,
        out: &DeviceBuffer,
    ) -> Dispatch {
        let source = kernel("gather", &[include_str!("wgsl/gather.wgsl")], &[("WIDTH", width)]);
        self.kernels.dispatch(self.gpu, source, &[first, second, index, out], (1, 1), [1, 1])
    }

    /// Returns `x += factor · y` over `n_items` values of each unit of the batch.
    pub fn add_scaled(
        &mut self,
        factor: f32,
        n_items: usize,
        y: &DeviceBuffer,
        x: &DeviceBuffer,
    ) -> Dispatch {
        let constants = [("ITEMS", n_items), ("FACTOR", factor.to_bits() as usize)];
        let source = kernel("add_scaled", &[BATCH, include_str!("wgsl/add_scaled.wgsl")], &constants);
        self.kernels.dispatch(self.gpu, source, &[self.batch, y, x], (n_items, THREADS), [1, 1])
    }
}
