//! Display of an error together with its causes.

use std::error::Error;

/// Characters of a value that a message shows.
const MAX_VALUE: usize = 200;

/// Returns the messages of `error` and of every [`Error::source`] below it, joined by `: `.
///
/// An error of this project either prints its cause or returns it from `source()`, never both, so that the
/// joined text names each cause exactly once. Some errors of other crates do both: what they repeat is left
/// out. Use this wherever an error leaves the process as text.
///
/// Errors quote files and arguments, which may contain line breaks or commands for a terminal. The text is
/// one line, with control characters written as in a Rust string.
#[must_use]
pub fn error_chain(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| (*cause).source());
    let text = causes.fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        if text.ends_with(&cause) { text } else { format!("{text}: {cause}") }
    });
    one_line(text.trim_end())
}

/// Returns a text from outside as one line, with control characters written as in a Rust string and long
/// values shortened.
#[must_use]
pub fn one_line(text: &str) -> String {
    escaped(&shorten(text), &[])
}

/// Returns a text with control characters, except line breaks and tabs, written as in a Rust string: what it
/// quotes from outside cannot command a terminal.
#[must_use]
pub fn printable(text: &str) -> String {
    escaped(text, &['\n', '\t'])
}

fn escaped(text: &str, except: &[char]) -> String {
    let escape = |c: char| {
        if c.is_control() && !except.contains(&c) { c.escape_default().to_string() } else { c.to_string() }
    };
    text.chars().map(escape).collect()
}

/// Returns a message with every quoted value and every word of more than 200 characters cut in its middle.
#[must_use]
pub fn shorten(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.chars().next() {
        let before = short.chars().next_back();
        let opens = matches!(start, '`' | '\'' | '"') && before.is_none_or(|c| c.is_whitespace() || c == '(');
        let end = opens.then(|| closing_quote(rest, start)).flatten();
        let word = || rest.find(char::is_whitespace).unwrap_or(rest.len()).max(start.len_utf8());
        let (value, after) = rest.split_at(end.unwrap_or_else(word));
        short += &cut(value);
        rest = after;
    }
    short
}

/// Returns the position after the quotation mark that ends the value at the start of `text`: one before a
/// space, a punctuation mark or the end.
fn closing_quote(text: &str, mark: char) -> Option<usize> {
    let ends = |rest: &str| rest.chars().next().is_none_or(|c| c.is_whitespace() || ",;:.)".contains(c));
    let after = text.match_indices(mark).skip(1).map(|(idx, mark)| idx + mark.len());
    after.into_iter().find(|idx| ends(&text[*idx..]))
}

/// Returns a value without its middle, if it is long.
fn cut(value: &str) -> String {
    let n_chars = value.chars().count();
    if n_chars <= MAX_VALUE {
        return value.to_owned();
    }
    let head: String = value.chars().take(MAX_VALUE / 2).collect();
    let tail: String = value.chars().skip(n_chars - MAX_VALUE / 4).collect();
    format!("{head}… ({n_chars} characters) …{tail}")
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use ipc_types::link::{BudgetError, LinkError};

    #[test]
    fn every_cause_appears_once_in_order() {
        let source = std::io::Error::other("disk on fire");
        let error = LinkError::from(BudgetError::Unknown { path: PathBuf::from("/dev/shm"), source });
        assert_eq!(error_chain(&error), "failed to query the free space of /dev/shm: disk on fire");
    }

    #[derive(Debug)]
    struct Repeats(std::io::Error);

    impl std::fmt::Display for Repeats {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            write!(f, "I/O error: {}", self.0)
        }
    }

    impl Error for Repeats {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            Some(&self.0)
        }
    }

    #[test]
    fn repeated_cause_is_left_out() {
        let error = Repeats(std::io::Error::other("disk on fire"));
        assert_eq!(error_chain(&error), "I/O error: disk on fire");
    }

    #[test]
    fn long_values_lose_their_middle() {
        let long = "a b\n".repeat(5000);
        for value in [long.clone(), long.replace(' ', "'"), "x".repeat(9999), "日".repeat(201)] {
            for text in [
                format!("invalid value '{value}' for '--x': no number"),
                format!("unknown key `{value}`, expected `a`"),
            ] {
                let short = one_line(&text);
                assert!(short.chars().count() < 300 && short.contains("characters) …"), "{short}");
                assert!(short.contains("no number") || short.contains("expected `a`"), "{short}");
            }
        }
        let word = one_line(&format!("failed to open /{}/x.db: no", "y".repeat(9999)));
        assert!(word.len() < 250 && word.ends_with("y/x.db: no"), "{word}");
        for same in ["the user's `a`, 'b' and it's fine", " two  spaces ", &"word ".repeat(100)] {
            assert_eq!(one_line(same), same);
        }
    }

    #[test]
    fn control_characters_are_escaped() {
        let error = std::io::Error::other("unknown key `\u{1b}[2J\né`\n");
        assert_eq!(error_chain(&error), r"unknown key `\u{1b}[2J\né`");
    }
}
