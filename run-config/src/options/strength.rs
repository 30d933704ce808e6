//! The strength of perturbations.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The strength of a perturbation, from [`Strength::MIN`] to 1; 1 is the benchmark's.
///
/// Continuous ranges are interpolated from their nominal value by the strength. Discrete replacements (a
/// texture, an instruction, a distractor object) happen with the strength as their probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Strength(f64);

/// Errors that can occur while making a [`Strength`].
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum StrengthError {
    /// The number is below [`Strength::MIN`] or above 1.
    #[error("strength is {found}, expected a number from 0.001 to 1 (the benchmark's strength)")]
    OutOfRange {
        /// The rejected strength.
        found: f64,
    },
    /// The text is not a number.
    #[error("expected a number from 0.001 to 1 (the benchmark's strength)")]
    NotANumber,
}

impl Strength {
    /// The strength of the benchmark.
    pub const FULL: Self = Self(1.0);
    /// The smallest strength: a thousandth of the benchmark's ranges, which no camera sees.
    pub const MIN: f64 = 1e-3;

    /// Returns the number.
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
        if (Self::MIN..=1.0).contains(&found) {
            Ok(Self(found))
        } else {
            Err(StrengthError::OutOfRange { found })
        }
    }
}

impl FromStr for Strength {
    type Err = StrengthError;

    fn from_str(text: &str) -> Result<Self, StrengthError> {
        Self::try_from(text.parse::<f64>().map_err(|_| StrengthError::NotANumber)?)
    }
}

impl fmt::Display for Strength {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl From<Strength> for f64 {
    fn from(strength: Strength) -> Self {
        strength.0
    }
}
