//! An output matrix whose columns several threads compute at the same time.

use std::marker::PhantomData;

/// A matrix that threads write concurrently, each to its own columns.
pub(crate) struct SharedOutput<'a> {
    start: *mut f32,
    len: usize,
    _memory: PhantomData<&'a mut [f32]>,
}

// SAFETY: the pointer is only used through `at`, whose caller guarantees that no two threads use the same
// values.
unsafe impl Sync for SharedOutput<'_> {}

impl<'a> SharedOutput<'a> {
    pub(crate) fn new(out: &'a mut [f32]) -> Self {
        Self { start: out.as_mut_ptr(), len: out.len(), _memory: PhantomData }
    }

    /// Returns a pointer to `count` rows of `width` values, `stride` values apart, starting at `offset`.
    ///
    /// # Panics
    /// If the last row would end outside the matrix.
    ///
    /// # Safety
    /// No other thread may access these values while the pointer is in use.
    pub(crate) unsafe fn at(&self, offset: usize, count: usize, stride: usize, width: usize) -> *mut f32 {
        assert!(
            count > 0 && offset + (count - 1) * stride + width <= self.len,
            "{count} rows of {width} values at {offset}, in a matrix of {}",
            self.len
        );
        // SAFETY: the offset is inside the matrix.
        unsafe { self.start.add(offset) }
    }
}
