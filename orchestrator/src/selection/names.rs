//! Lookup of names typed by a user, with suggestions for misspelt ones.

use std::error::Error;
use std::ffi::OsStr;

use clap::builder::{PossibleValue, TypedValueParser};
use clap::{Arg, Command};
use thiserror::Error;

/// Maximum number of suggestions in one message.
const MAX_SUGGESTIONS: usize = 3;
/// Minimum Jaro–Winkler similarity of a suggestion. Below it, a name is not a misspelling but another word.
const MIN_SIMILARITY: f64 = 0.7;

/// An unknown name, with the known names that are most similar to it.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("unknown {kind} `{typed}`{}", hint(kind, suggestions, known))]
pub(crate) struct UnknownName {
    kind: &'static str,
    typed: String,
    suggestions: Vec<String>,
    known: Vec<String>,
}

impl UnknownName {
    /// Describes `typed` where one of `known` was expected.
    pub(crate) fn new(kind: &'static str, typed: &str, known: &[&str]) -> Self {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        Self {
            kind,
            typed: typed.to_owned(),
            suggestions: owned(&most_similar(typed, known)),
            known: owned(known),
        }
    }
}

/// Returns the item of `all` whose name is `typed`, ignoring case.
///
/// # Errors
/// If no item has that name.
pub(crate) fn pick<T: Copy>(
    kind: &'static str,
    typed: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T, UnknownName> {
    all.iter().copied().find(|&item| name(item).eq_ignore_ascii_case(typed)).ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|&item| name(item)).collect();
        UnknownName::new(kind, typed, &known)
    })
}

/// A clap value parser for named values. It reports unknown names with suggestions and offers the names to
/// shell completions.
#[derive(Debug)]
pub(crate) struct NameParser<T, E> {
    /// Parses one value.
    pub(crate) parse: fn(&str) -> Result<T, E>,
    /// Returns the names to complete.
    pub(crate) names: fn() -> Vec<&'static str>,
}

impl<T, E> Clone for NameParser<T, E> {
    fn clone(&self) -> Self {
        Self { ..*self }
    }
}

impl<T, E> TypedValueParser for NameParser<T, E>
where
    T: Clone + Send + Sync + 'static,
    E: Into<Box<dyn Error + Send + Sync>> + 'static,
{
    type Value = T;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<T, clap::Error> {
        TypedValueParser::parse_ref(&self.parse, command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new((self.names)().into_iter().map(PossibleValue::new)))
    }
}

/// Returns the names most similar to `typed`, in descending order of similarity.
fn most_similar<'a>(typed: &str, known: &[&'a str]) -> Vec<&'a str> {
    let typed = typed.to_ascii_lowercase();
    let similarity = |name: &str| strsim::jaro_winkler(&typed, &name.to_ascii_lowercase());
    let mut scored: Vec<(f64, &str)> = known.iter().map(|&name| (similarity(name), name)).collect();
    scored.retain(|(score, _)| *score >= MIN_SIMILARITY);
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().take(MAX_SUGGESTIONS).map(|(_, name)| name).collect()
}

fn hint(kind: &str, suggestions: &[String], known: &[String]) -> String {
    match suggestions {
        // Too many to list.
        [] if matches!(kind, "task" | "perturbation") => {
            "; `hypogeum tasks --matrix` lists all names".to_owned()
        }
        [] => format!("; expected one of {}", known.join(", ")),
        [one] => format!("; did you mean {one}?"),
        [others @ .., last] => format!("; did you mean {} or {last}?", others.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRUIT: [&str; 4] = ["Apple", "Apricot", "Banana", "Pineapple"];

    #[test]
    fn pick_ignores_case_and_suggests_similar_names() {
        let pick = |typed| pick("fruit", typed, &FRUIT, |name| name);
        assert_eq!(pick("banana"), Ok("Banana"));
        insta::assert_snapshot!(pick("Aple").unwrap_err(), @"unknown fruit `Aple`; did you mean Apple?");
        insta::assert_snapshot!(pick("Bananna").unwrap_err(), @"unknown fruit `Bananna`; did you mean Banana?");
        insta::assert_snapshot!(pick("xyz").unwrap_err(), @"unknown fruit `xyz`; expected one of Apple, Apricot, Banana, Pineapple");
    }
}
