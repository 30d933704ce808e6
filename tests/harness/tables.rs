//! Tables that `hypogeum report` shows beside the results.

use orchestrator::fuzzing::read_tables;

use super::edits::Edits;
use super::refused;
use super::results::SAMPLE;

const HARDWARE: &str =
    "task,perturbation,success_percent\nRaiseCube,None,50\nStackCube,MO-Color+Camera-Pose,0.5\n";
const FPS: &str = "batch_size,frames_per_second,note\n1,100.5,\n1024,2e5,x\n";

/// Reads two tables, and draws them.
///
/// # Panics
/// If an error is unclear.
pub fn run(data: &[u8]) -> bool {
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
    let results = folder.path().join("results.db");
    std::fs::write(&results, &*SAMPLE).unwrap();
    match read_tables(&results, &paths[0], &paths[1]) {
        Ok(()) => true,
        Err(message) => {
            let path = if message.contains("hardware.csv") { &paths[0] } else { &paths[1] };
            refused(&message, path)
        }
    }
}
