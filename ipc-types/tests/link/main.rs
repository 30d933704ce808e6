//! The link, through its public door and between real processes: this binary starts itself again for the other side.

mod allocations;
mod domains;
mod foreign;
mod memory;
mod processes;
mod roles;
mod scratch;
