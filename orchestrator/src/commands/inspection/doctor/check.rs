//! The result of a check: its status, what was found, and advice.

use serde::Serialize;

/// The result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum CheckStatus {
    /// Ready.
    Ok,
    /// Works, but not everything or not well.
    Warning,
    /// Runs fail or give wrong results.
    Problem,
}

/// One check.
#[derive(Debug, Serialize)]
pub(crate) struct Check {
    name: &'static str,
    pub(crate) status: CheckStatus,
    /// Finding.
    found: String,
    /// Advice; empty if nothing is to be done.
    advice: String,
}

impl Check {
    pub(crate) fn new(
        name: &'static str,
        status: CheckStatus,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self { name, status, found: found.into(), advice: advice.into() }
    }

    pub(crate) fn ok(name: &'static str, found: impl Into<String>) -> Self {
        Self::new(name, CheckStatus::Ok, found, "")
    }

    /// Formats the check as one line, or two if there is advice.
    pub(crate) fn text(&self) -> String {
        let mark = match self.status {
            CheckStatus::Ok => "ok     ",
            CheckStatus::Warning => "warning",
            CheckStatus::Problem => "PROBLEM",
        };
        let advice =
            if self.advice.is_empty() { String::new() } else { format!("\n         → {}", self.advice) };
        format!("{mark}  {}: {}{advice}\n", self.name, self.found)
    }
}
