//! The names under which iceoryx2 registers the message types. A foreign host must declare the same names
//! and sizes.

use iceoryx2::prelude::{ZeroCopySend, ipc_threadsafe};

use crate::frame::{ActionHeader, ObservationHeader};
use crate::layout::Page;

/// iceoryx2's thread-safe service variant, whose ports may move between threads. Its uncontended lock costs a
/// few nanoseconds per operation.
pub(crate) type Ipc = ipc_threadsafe::Service;

// SAFETY: `Page` is a `repr(C)` array of bytes: self-contained, without pointers, and identical in every
// process. (The derive macro rejects `repr(C, align(N))`.)
unsafe impl ZeroCopySend for Page {
    unsafe fn type_name() -> &'static str {
        "hyp.Page.v1"
    }
}

// SAFETY: `ObservationHeader` is `repr(C)` and Pod: fixed-width integers without padding or pointers.
unsafe impl ZeroCopySend for ObservationHeader {
    unsafe fn type_name() -> &'static str {
        "hyp.ObservationHeader.v1"
    }
}

// SAFETY: as for `ObservationHeader`.
unsafe impl ZeroCopySend for ActionHeader {
    unsafe fn type_name() -> &'static str {
        "hyp.ActionHeader.v1"
    }
}
