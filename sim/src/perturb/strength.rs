//! How strong perturbations are.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A number in (0, 1]. Ranges shrink towards their nominal value by it, and what is chosen rather than ranged (a pattern, a
/// sentence, a distractor) is chosen with it as its chance. 1 is the benchmark.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Strength(f64);

/// A number that is no strength.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("strength is {found}, expected a number above 0 and up to 1, the benchmark's")]
pub struct StrengthError {
    /// The number.
    pub found: f64,
}

impl Strength {
    /// As in the benchmark.
    pub const FULL: Self = Self(1.0);

    /// The number, in (0, 1].
    #[must_use]
    pub const fn get(self) -> f64 {
        self.0
    }
}

impl Default for Strength {
    fn default() -> Self {
        Self::FULL
    }
}

impl TryFrom<f64> for Strength {
    type Error = StrengthError;

    fn try_from(found: f64) -> Result<Self, StrengthError> {
        if found > 0.0 && found <= 1.0 { Ok(Self(found)) } else { Err(StrengthError { found }) }
    }
}

impl From<Strength> for f64 {
    fn from(strength: Strength) -> Self {
        strength.0
    }
}
