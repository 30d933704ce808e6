//! Neural network kernels on the CPU: sequential, over faer's matrix product, on slices that the caller owns.
//!
//! Every kernel computes each number by a fixed sequence of operations that does not depend on how many rows, images
//! or samples are computed beside it. Nothing here starts a thread, and nothing allocates once its weights are made:
//! working memory is handed in.
//!
//! Letters in shapes: `T` rows (tokens), `D` model width, `H` and `W` sides of an image, `C` channels.

/// How the weights of a layer are kept and multiplied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// As they are.
    #[default]
    F32,
    /// Rounded to eight bits ([`quantised`]), where there are enough of them for that to be faster.
    Int8,
}

pub mod attention;
pub mod conv;
pub mod gelu;
pub mod linear;
pub mod maps;
pub mod matmul;
pub mod norm;
pub mod packed;
pub mod pool;

mod quantised;

mod wide;
mod winograd;
