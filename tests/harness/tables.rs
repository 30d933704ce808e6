//! Tables that `hypogeum report` shows beside the results.

use orchestrator::fuzzing::read_tables;

use super::assert_one_line;
use super::edits::Edits;

const HARDWARE: &str =
    "task,perturbation,success_percent\nRaiseCube,None,50\nStackCube,MO-Color+Camera-Pose,0.5\n";
const FPS: &str = "batch_size,frames_per_second,note\n1,100.5,\n1024,2e5,x\n";

/// Reads two tables.
///
/// # Panics
/// If an error is unclear.
pub fn run(data: &[u8]) {
    let mut edits = Edits::new(data);
    let folder = tempfile::tempdir().unwrap();
    let paths = ["hardware.csv", "fps.csv"].map(|name| folder.path().join(name));
    for (path, text) in paths.iter().zip([HARDWARE, FPS]) {
        let mut text = text.as_bytes().to_vec();
        if edits.below(2) == 0 {
            edits.bytes(&mut text);
        }
        std::fs::write(path, text).unwrap();
    }
    if let Err(message) = read_tables(&paths[0], &paths[1]) {
        assert!(message.contains("hardware.csv") || message.contains("fps.csv"), "{message}");
        assert_one_line(&message);
    }
}
