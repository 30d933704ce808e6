//! Commands that show what there is: tasks and their images, this machine, a checkpoint to measure with.

pub(crate) mod checkpoint;
pub(crate) mod doctor;
pub(crate) mod show;
pub(crate) mod tasks;
