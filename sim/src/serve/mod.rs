//! Serving episodes: the control plane's messages, the slots, and the loop that steps, renders and queries.

pub mod protocol;
