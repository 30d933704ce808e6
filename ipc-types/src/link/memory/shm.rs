//! The path of shared memory.

/// Mount point of POSIX shared memory on Linux.
pub const SHM: &str = "/dev/shm";
