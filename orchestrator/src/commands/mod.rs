//! The subcommands of `hypogeum`: one file each, with its arguments and the function that runs it.
//!
//! A command parses nothing and computes little; it connects the services of this crate. Code that several
//! commands use lives in those services, and no service depends on a command.

pub(crate) mod child;
pub(crate) mod completions;
pub(crate) mod distribution;
pub(crate) mod evaluation;
pub(crate) mod inspection;
pub(crate) mod results;
