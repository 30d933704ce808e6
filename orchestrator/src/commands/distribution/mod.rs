//! Commands for sweeps that run as shards on several machines.

pub(crate) mod merge;
pub(crate) mod status;
pub(crate) mod submit;
