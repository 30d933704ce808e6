//! Everything that is kept: results files, what is exported from them, packages, and datasets of
//! demonstrations.

pub(crate) mod build_identity;
pub(crate) mod demos;
pub(crate) mod export;
pub(crate) mod merging;
pub(crate) mod package;
pub(crate) mod parquet_table;
pub(crate) mod results;
pub(crate) mod shards;
pub(crate) mod stored_episode;
