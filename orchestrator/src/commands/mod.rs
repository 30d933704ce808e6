//! The subcommands of `hypogeum`: one file each, with its arguments and the function that runs it.
//!
//! A command parses nothing and computes little; it connects the services of this crate. Code that several
//! commands use lives in those services, and no service depends on a command.

pub(crate) mod checkpoint;
pub(crate) mod child;
pub(crate) mod compare;
pub(crate) mod completions;
pub(crate) mod demos;
pub(crate) mod doctor;
pub(crate) mod fps;
pub(crate) mod pack;
pub(crate) mod plan;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod run;
pub(crate) mod show;
pub(crate) mod tasks;
mod trajectory;
pub(crate) mod verify;
