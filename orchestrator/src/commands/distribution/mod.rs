//! Commands for sweeps that many machines share.

pub(crate) mod merge;
