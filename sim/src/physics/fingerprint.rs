//! A hash of trajectories, for bit-exact comparison of runs.

use xxhash_rust::xxh3::Xxh3Default;

/// An xxh3-64 hash over the bit patterns of a sequence of f32 values.
#[derive(Clone, Default)]
pub struct Fingerprint(Xxh3Default);

impl core::fmt::Debug for Fingerprint {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Fingerprint({:016x})", self.finish())
    }
}

impl Fingerprint {
    /// Appends values to the hashed sequence.
    pub fn write(&mut self, numbers: &[f32]) {
        self.0.update(bytemuck::cast_slice(numbers));
    }

    /// Returns the hash of all values written so far.
    #[must_use]
    pub fn finish(&self) -> u64 {
        self.0.digest()
    }
}
