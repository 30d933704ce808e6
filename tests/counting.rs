//! An allocator that counts, for the tests of all crates that prove that something allocates nothing.

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

// SAFETY: every call is passed on to the system's allocator unchanged; the counts are plain numbers that allocate nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is the system allocator's requirement.
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

/// How often this thread and how often the whole process allocates during some work.
pub(crate) fn allocations<T>(work: impl FnOnce() -> T) -> ([usize; 2], T) {
    let so_far = || [OF_THREAD.get(), OF_PROCESS.load(Ordering::Relaxed)];
    let before = so_far();
    let result = work();
    let after = so_far();
    ([after[0] - before[0], after[1] - before[1]], result)
}
