//! The partition of a sweep into shards.

mod shard;

pub(crate) use self::shard::{MAX_SHARDS, Shard, ShardError, ShardRequest};
