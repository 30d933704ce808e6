//! Neural network kernels for the CPU: sequential, on slices that the caller owns.
//!
//! Every kernel computes each value by a fixed sequence of operations, independent of how many rows, images
//! or samples are computed together. Kernels start no threads, and they allocate nothing after construction:
//! the caller passes their working memory. The exception is [`projection`], for networks whose weights fill
//! gigabytes: it shares the columns of a product among the threads of the current rayon pool, and allocates
//! memory for quantised inputs. [`gemm::peak`] is no kernel, but measures what a kernel can reach. See
//! `README.md` for the design and its measurements.
//!
//! Letters in shapes: `t` rows (tokens), `d` model width, `n` images, `c` channels, `h` and `w` height and
//! width; `[m, k] · [k, n]` in matrix products.

pub mod attention;
pub mod conv;
pub mod gelu;
pub mod gemm;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod linear;
pub mod norm;
pub mod projection;
pub mod rotary;

mod isa;

use serde::{Deserialize, Serialize};

/// Numeric precision of a layer's weights and products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Precision {
    /// 32-bit floating point.
    #[default]
    F32,
    /// 8-bit integers (`quantised`), in layers large enough to become faster.
    Int8,
}
