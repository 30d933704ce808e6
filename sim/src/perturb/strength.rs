//! Strength of perturbations.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The strength of a perturbation, in (0, 1]; 1 is the benchmark's.
///
/// Continuous ranges are interpolated from their nominal value by the strength. Discrete replacements (a
/// texture, an instruction, a distractor object) happen with the strength as their probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Strength(f64);

/// The error returned for a strength outside (0, 1].
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("strength is {found}, expected a number above 0 and at most 1 (the benchmark's strength)")]
pub struct StrengthError {
    /// The rejected value.
    pub found: f64,
}

impl Strength {
    /// The benchmark's strength, 1.
    pub const FULL: Self = Self(1.0);

    /// Returns the strength as a number in (0, 1].
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
