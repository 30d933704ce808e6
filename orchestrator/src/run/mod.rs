//! Running a plan, and running stored episodes again: the fleet from start to end, early stopping, displays
//! and recordings on the way.

pub(crate) mod execution;
pub(crate) mod live;
pub(crate) mod movie;
pub(crate) mod observer;
pub(crate) mod playback;
pub(crate) mod recorder;
pub(crate) mod sharding;
pub(crate) mod stopping;
pub(crate) mod trace_file;
