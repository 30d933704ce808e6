//! From a typed name to the thing it names, or to the names that come nearest.

use thiserror::Error;

/// Suggestions in one message.
const MOST_SUGGESTIONS: usize = 3;
/// Least Jaro–Winkler similarity of a suggestion; below it a name is not a misspelling but another word.
const LEAST_SIMILARITY: f64 = 0.7;
/// Names that a message lists in full when none comes near.
const MOST_LISTED: usize = 12;

/// A name that names nothing.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("unknown {kind} `{typed}`{}", hint(suggestions, known))]
pub(crate) struct UnknownName {
    kind: &'static str,
    typed: String,
    suggestions: Vec<String>,
    known: Vec<String>,
}

impl UnknownName {
    /// For what was typed where one of `known` was expected.
    pub(crate) fn new(kind: &'static str, typed: &str, known: &[&str]) -> Self {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        Self {
            kind,
            typed: typed.to_owned(),
            suggestions: owned(&nearest(typed, known)),
            known: owned(known),
        }
    }
}

/// The one of `all` whose name was typed, in whatever case.
///
/// # Errors
/// If none has it.
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

/// The names most like `typed`, the likest first.
fn nearest<'a>(typed: &str, known: &[&'a str]) -> Vec<&'a str> {
    let typed = typed.to_ascii_lowercase();
    let similarity = |name: &str| strsim::jaro_winkler(&typed, &name.to_ascii_lowercase());
    let mut scored: Vec<(f64, &str)> = known.iter().map(|&name| (similarity(name), name)).collect();
    scored.retain(|(score, _)| *score >= LEAST_SIMILARITY);
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().take(MOST_SUGGESTIONS).map(|(_, name)| name).collect()
}

fn hint(suggestions: &[String], known: &[String]) -> String {
    match (suggestions, known) {
        ([], known) if known.len() <= MOST_LISTED => format!("; known are {}", known.join(", ")),
        ([], _) => "; `hypogeum tasks --matrix` lists them".to_owned(),
        ([one], _) => format!("; did you mean {one}?"),
        ([others @ .., last], _) => format!("; did you mean {} or {last}?", others.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRUIT: [&str; 4] = ["Apple", "Apricot", "Banana", "Pineapple"];

    #[test]
    fn a_name_is_found_in_any_case_and_a_misspelt_one_is_suggested() {
        let pick = |typed| pick("fruit", typed, &FRUIT, |name| name);
        assert_eq!(pick("banana"), Ok("Banana"));
        insta::assert_snapshot!(pick("Aple").unwrap_err(), @"unknown fruit `Aple`; did you mean Apple?");
        insta::assert_snapshot!(pick("Bananna").unwrap_err(), @"unknown fruit `Bananna`; did you mean Banana?");
        insta::assert_snapshot!(pick("xyz").unwrap_err(), @"unknown fruit `xyz`; known are Apple, Apricot, Banana, Pineapple");
    }
}
