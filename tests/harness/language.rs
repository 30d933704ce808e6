//! Files of paraphrases (`--language`).

use ipc_types::layout::INSTRUCTION_BYTES;
use run_config::{Instructions, LanguageFile, error_chain};
use sim::perturb::{Composition, Language, Strength};
use sim::{Perturbation, Profile, TaskId};

use super::edits::Edits;
use super::refused;

/// Files in the ways in which YAML can be written.
const FILES: [&str; 3] = [
    "RaiseCube-v1:\n- lift the cube\n- \"hoist: it\"\n- >-\n  folded\n  text\nStackCube-v1: ['a', \"b\", c]\n",
    "---\n? RaiseCube-v1\n: - &one raise it\n  - *one\n  - | \n   several\n   lines\n...\n",
    "{RaiseCube-v1: [up, !!str 3], StackCube-v1: [\"\\u00e9\"]} # a comment\n",
];

/// Reads a file, and draws the instruction of a task from it.
///
/// # Panics
/// If an error is unclear, or the instruction does not fit into a message.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sentences.yaml");
    let mut text = edits.word(&FILES).as_bytes().to_vec();
    if edits.below(8) == 1 {
        nest(&mut edits, &mut text);
    }
    edits.bytes(&mut text);
    std::fs::write(&path, text).unwrap();
    let file = LanguageFile::open(&path).unwrap();
    let task = TaskId::RaiseCube.task();
    let profile = if edits.below(2) == 0 { Profile::Strict } else { Profile::Paper };
    let language = if edits.below(2) == 0 {
        Language::read(&Instructions::Act, Some(&file))
    } else {
        Language::read(&Instructions::File(file), None)
    };
    let sentences = match language {
        Ok(sentences) => sentences,
        Err(error) => return refused(&error_chain(&error), &path),
    };
    if let Err(error) = sentences.require(task, profile) {
        return refused(&error_chain(&error), &path);
    }
    let composition = Composition::from(Perturbation::LanguageParaphrase);
    let mut spec = composition.spec(task, profile, Strength::FULL);
    sentences.apply(task, profile, &mut spec);
    let instruction = spec.draw(edits.number()).instruction;
    assert!((1..=INSTRUCTION_BYTES).contains(&instruction.len()), "{instruction:?}");
    true
}

/// Nests a value, or repeats an alias of an alias.
fn nest(edits: &mut Edits<'_>, text: &mut Vec<u8>) {
    let n = 1 + edits.below(4000);
    *text = match edits.below(3) {
        0 => "[".repeat(n).into_bytes(),
        1 => (0..n).map(|depth| format!("{}- \n", " ".repeat(depth % 100))).collect::<String>().into_bytes(),
        _ => (1..n % 40)
            .map(|idx| format!("a{idx}: &a{idx} [*a{0}, *a{0}, *a{0}]\n", idx - 1))
            .fold("a0: &a0 [x]\n".to_owned(), |all, line| all + &line)
            .into_bytes(),
    };
}
