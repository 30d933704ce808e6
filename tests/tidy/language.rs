//! The language of names and comments, and the form of tests.

use std::collections::BTreeMap;

use crate::source::{Source, assert_none, rust_sources, with_extension};

/// Maximum length of a line that holds a comment, in characters.
const MAX_COMMENT_COLUMNS: usize = 110;
/// Maximum number of words in a test's name.
const MAX_TEST_NAME_WORDS: usize = 8;
/// First words that turn a doc comment into a riddle. Start with a noun phrase or a third-person verb
/// instead.
const BAD_DOC_OPENINGS: [&str; 9] =
    ["What", "Whether", "How", "Where", "Why", "Who", "When", "Which", "That"];
/// Words of a private vocabulary that the code base once had, one per line, each with the standard term.
const RETIRED_WORDS: &str = include_str!("retired_words.txt");
/// Fragments of paths and titles of documents that are not part of the repository.
const PRIVATE_REFERENCES: [&str; 3] = ["spec/", "DESIGN", "STYLE"];

/// Returns `path:line: text` for every line of `sources` for which `is_bad` holds.
fn lines_where(sources: &[Source], is_bad: impl Fn(&Source, &str) -> bool) -> Vec<String> {
    let bad = |source: &Source| {
        let lines = source.numbered().filter(|(_, line)| is_bad(source, line));
        lines.map(|(number, line)| format!("{}:{number}: {}", source.path, line.trim())).collect::<Vec<_>>()
    };
    sources.iter().filter(|source| !source.path.starts_with("tests/tidy/")).flat_map(bad).collect()
}

/// Returns `true` if `text` contains `word` with no letter, digit or underscore next to it.
fn has_word(text: &str, word: &str) -> bool {
    let is_word_char = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        !text[..at].ends_with(is_word_char) && !text[at + word.len()..].starts_with(is_word_char)
    })
}

#[test]
fn doc_comments_open_with_a_noun_or_verb() {
    let mut bad = Vec::new();
    for source in rust_sources() {
        for (number, lines) in source.docs() {
            let paragraphs = lines.split(|line| line.is_empty()).filter_map(|lines| lines.first());
            let first = paragraphs.take(1).next().copied().unwrap_or_default();
            if BAD_DOC_OPENINGS.iter().any(|word| first.split(' ').next() == Some(word)) {
                bad.push(format!("{}:{number}: {first}", source.path));
            }
        }
    }
    assert_none(&bad, "doc comments open with a noun phrase or a third-person verb");
}

#[test]
fn names_and_comments_use_standard_terms() {
    for line in RETIRED_WORDS.lines() {
        let (word, standard) = line.split_once(": ").unwrap();
        let uses = lines_where(&rust_sources(), |_, line| has_word(line, word));
        assert_none(&uses, &format!("write {standard} instead of `{word}`"));
    }
}

#[test]
fn comments_refer_only_to_tracked_documents() {
    let sources = with_extension(&["rs", "py", "wgsl", "md"]);
    let uses = lines_where(&sources, |_, line| PRIVATE_REFERENCES.iter().any(|name| line.contains(name)));
    assert_none(&uses, "refer to docs/ or to a published source");
}

#[test]
fn comment_lines_are_short() {
    let sources = with_extension(&["rs", "py", "wgsl"]);
    let long = lines_where(&sources, |source, line| {
        let marker = if source.path.ends_with(".py") { "#" } else { "//" };
        let comment = line.trim_start().starts_with(marker);
        comment && !line.contains("http") && line.chars().count() > MAX_COMMENT_COLUMNS
    });
    assert_none(&long, &format!("comment lines have at most {MAX_COMMENT_COLUMNS} characters"));
}

#[test]
fn test_names_are_short() {
    let mut long = Vec::new();
    for source in rust_sources() {
        let lines: Vec<&str> = source.text.lines().map(str::trim).collect();
        for pair in lines.windows(2).filter(|pair| pair[0] == "#[test]") {
            let name = pair[1].trim_start_matches("fn ").split('(').next().unwrap();
            if name.split('_').count() > MAX_TEST_NAME_WORDS {
                long.push(format!("{}: {name}", source.path));
            }
        }
    }
    assert_none(&long, &format!("test names have at most {MAX_TEST_NAME_WORDS} words"));
}

/// A test that cannot run somewhere is reported as ignored, with the reason.
#[test]
fn tests_do_not_return_early() {
    let mut early = Vec::new();
    for source in rust_sources().iter().filter(|source| source.path != "tests/tidy/language.rs") {
        let (mut in_test, mut indent) = (false, 0);
        for (number, line) in source.numbered() {
            let code = line.trim();
            if code == "#[test]" {
                (in_test, indent) = (true, line.len() - code.len());
            } else if code == "}" && line.len() - code.len() == indent {
                in_test = false;
            } else if in_test && (code.contains("return;") || code.contains("{ return }")) {
                early.push(format!("{}:{number}: {code}", source.path));
            }
        }
    }
    assert_none(&early, "a test that needs what is not everywhere has `#[ignore = \"needs ...\"]`");
}

#[test]
fn type_names_are_unique_in_the_workspace() {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for source in rust_sources() {
        for (number, line) in source.numbered() {
            if let Some(name) = defined_type(line) {
                places.entry(name.to_owned()).or_default().push(format!("{}:{number}", source.path));
            }
        }
    }
    let repeated = places.iter().filter(|(_, places)| places.len() > 1);
    let repeated: Vec<String> =
        repeated.map(|(name, places)| format!("{name}: {}", places.join(", "))).collect();
    assert_none(&repeated, "no type name is used for two different things");
}

/// Returns the name of the struct, enum, union, trait or free type alias that a line defines. Associated
/// types, which are indented `type` items, do not count.
fn defined_type(line: &str) -> Option<&str> {
    let is_indented = line.starts_with(' ');
    let mut words = line.split_whitespace().skip_while(|word| *word == "pub" || word.starts_with("pub("));
    let keyword = words.next()?;
    let defines = match keyword {
        "struct" | "enum" | "union" | "trait" => true,
        "type" => !is_indented,
        _ => false,
    };
    let name = words.next()?.split(|c: char| !c.is_alphanumeric()).next()?;
    (defines && name.starts_with(|c: char| c.is_ascii_uppercase())).then_some(name)
}
