//! Shared memory itself: where it lies, how much a run takes, and what is the matter when it runs short.

pub(crate) mod budget;
pub(crate) mod prefault;
pub(crate) mod shm;
pub(crate) mod shortage;
