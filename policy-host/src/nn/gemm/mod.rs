//! Matrix products: of activations ([`matmul`]), and of activations with weights that are packed
//! ([`packed`]), stay in their file (`stored`) or have 8 bits (`quantised`). [`peak`] measures what they can
//! reach.

pub mod matmul;
pub mod packed;
pub mod peak;

pub(crate) mod quantised;
pub(crate) mod shared;
pub(crate) mod stored;

mod tile;
