//! A number that the user gives or leaves to the program.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A number of envs or threads. It is stored as a number, or as the word `auto`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "StoredAmount", into = "StoredAmount")]
pub enum Amount {
    /// The user chose, at least 1.
    Fixed(u32),
    /// The program chooses.
    Auto,
}

/// Errors that can occur while parsing an [`Amount`].
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("found `{found}`, expected auto or a whole number from 1")]
pub struct AmountError {
    found: String,
}

impl Amount {
    /// Returns a parser of command-line values for numbers up to `max`.
    pub fn parser(max: u32) -> impl Fn(&str) -> Result<Self, String> + Clone {
        move |text| match text.parse() {
            Ok(Self::Fixed(number)) if number > max => Err(format!("{number} is not in 1..={max}")),
            Ok(amount) => Ok(amount),
            Err(AmountError { .. }) => Err(format!("expected auto or a number from 1 to {max}")),
        }
    }

    /// Returns the number, or the result of `auto` if the program chooses.
    pub fn unwrap_or_else(self, auto: impl FnOnce() -> u32) -> u32 {
        match self {
            Self::Auto => auto(),
            Self::Fixed(number) => number,
        }
    }
}

impl Display for Amount {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Fixed(number) => number.fmt(f),
        }
    }
}

impl FromStr for Amount {
    type Err = AmountError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match (text.eq_ignore_ascii_case("auto"), text.parse()) {
            (true, _) => Ok(Self::Auto),
            (false, Ok(number)) if number > 0 => Ok(Self::Fixed(number)),
            _ => Err(AmountError { found: text.to_owned() }),
        }
    }
}

/// The JSON form of an [`Amount`].
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum StoredAmount {
    Number(u32),
    Word(String),
}

impl From<Amount> for StoredAmount {
    fn from(amount: Amount) -> Self {
        match amount {
            Amount::Auto => Self::Word(amount.to_string()),
            Amount::Fixed(number) => Self::Number(number),
        }
    }
}

impl TryFrom<StoredAmount> for Amount {
    type Error = AmountError;

    fn try_from(stored: StoredAmount) -> Result<Self, Self::Error> {
        match stored {
            StoredAmount::Number(number) => number.to_string().parse(),
            StoredAmount::Word(word) => word.parse(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_survive_json() {
        for (amount, json) in [(Amount::Auto, "\"auto\""), (Amount::Fixed(7), "7")] {
            assert_eq!(serde_json::to_string(&amount).unwrap(), json);
            assert_eq!(serde_json::from_str::<Amount>(json).unwrap(), amount);
        }
        assert!(serde_json::from_str::<Amount>("0").is_err());
    }

    #[test]
    fn only_auto_and_numbers_in_range_parse() {
        let parse = Amount::parser(10);
        assert_eq!((parse("Auto"), parse("10")), (Ok(Amount::Auto), Ok(Amount::Fixed(10))));
        for (text, message) in [
            ("11", "11 is not in 1..=10"),
            ("0", "expected auto or a number from 1 to 10"),
            ("many", "expected auto or a number from 1 to 10"),
        ] {
            assert_eq!(parse(text), Err(message.to_owned()));
        }
    }
}
