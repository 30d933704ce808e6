//! Hash of a trajectory, for comparing runs bit for bit.

use xxhash_rust::xxh3::Xxh3Default;

/// xxh3-64 over the bit patterns of the numbers written to it, in order.
#[derive(Clone, Default)]
pub struct Fingerprint(Xxh3Default);

impl core::fmt::Debug for Fingerprint {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Fingerprint({:016x})", self.finish())
    }
}

impl Fingerprint {
    /// Adds numbers.
    pub fn write(&mut self, numbers: &[f32]) {
        self.0.update(bytemuck::cast_slice(numbers));
    }

    /// The hash of everything written so far.
    #[must_use]
    pub fn finish(&self) -> u64 {
        self.0.digest()
    }
}
