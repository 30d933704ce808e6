//! Commands that run episodes or plan them.

pub(crate) mod demos;
pub(crate) mod fps;
pub(crate) mod plan;
pub(crate) mod record;
pub(crate) mod run;
