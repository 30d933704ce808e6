//! The two hidden commands: this program as a child of itself.

use serde::de::DeserializeOwned;

use crate::cli::ChildArgs;
use crate::failure::{Ending, Failure, OrUser};

/// `hypogeum sim`: serves episodes until stdin closes.
pub(crate) fn sim(args: &ChildArgs) -> Result<Ending, Failure> {
    sim::serve::serve(&config(args)?)?;
    Ok(Ending::Done)
}

/// `hypogeum policy-host`: answers queries until stdin closes.
pub(crate) fn policy_host(args: &ChildArgs) -> Result<Ending, Failure> {
    policy_host::serve::serve(config(args)?)?;
    Ok(Ending::Done)
}

fn config<T: DeserializeOwned>(args: &ChildArgs) -> Result<T, Failure> {
    use anyhow::Context;
    serde_json::from_str(&args.config).context("failed to read --config").or_user()
}
