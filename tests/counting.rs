//! A counting global allocator, shared by the tests of all crates that assert that a code path does not
//! allocate.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

thread_local! {
    static OF_THREAD: Cell<usize> = const { Cell::new(0) };
}
static OF_PROCESS: AtomicUsize = AtomicUsize::new(0);

fn count() {
    OF_THREAD.set(OF_THREAD.get() + 1);
    OF_PROCESS.fetch_add(1, Ordering::Relaxed);
}

// SAFETY: every call is forwarded to the system allocator unchanged; updating the counters does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller upholds the contract of `GlobalAlloc::alloc`, which is forwarded as it is.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as in `alloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as in `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs `work` and returns the number of allocations made by this thread and by the whole process meanwhile.
pub(crate) fn allocations<T>(work: impl FnOnce() -> T) -> ([usize; 2], T) {
    let so_far = || [OF_THREAD.get(), OF_PROCESS.load(Ordering::Relaxed)];
    let before = so_far();
    let result = work();
    let after = so_far();
    ([after[0] - before[0], after[1] - before[1]], result)
}
