//! Trajectories (`hypogeum replay --start`).

use std::sync::LazyLock;

use run_config::error_chain;
use sim::physics::Parameters;
use sim::trajectory::{Replay, Start, TrajectoryFile, read_actions};

use super::edits::Edits;
use super::{refused, repository};

/// Recorded trajectories of one arm and of two, cut to a few steps.
static FILES: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| {
    let names = ["RaiseCube-v1.0", "StackCubeColosseumV2-v1.1", "DualArmLiftPot-v1.0"];
    names.map(|name| short(&format!("sim/tests/data/trajectories/{name}.json"))).into()
});
/// Steps that are executed.
const N_STEPS: usize = 3;

fn short(path: &str) -> Vec<u8> {
    let path = repository(path);
    let mut file = TrajectoryFile::read(&path).unwrap();
    file.actions.truncate(N_STEPS);
    if let Some(recorded) = &mut file.recorded {
        recorded.qpos.truncate(N_STEPS);
        recorded.tcp.truncate(N_STEPS);
    }
    serde_json::to_vec(&file).unwrap()
}

/// Reads a trajectory, and executes its first steps.
///
/// # Panics
/// If an error is unclear, or the file that was read differs from itself written and read again.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("start.json");
    let base = edits.pick(&FILES);
    let text = edits.json(base);
    std::fs::write(&path, text).unwrap();
    let file = match TrajectoryFile::read(&path) {
        Ok(file) => file,
        Err(error) => return refused(&error_chain(&error), &path),
    };
    let again = serde_json::from_str::<TrajectoryFile>(&serde_json::to_string(&file).unwrap()).unwrap();
    assert_eq!(again, file);
    let start = match Start::resolve(&file, &path) {
        Ok(start) => start,
        Err(error) => return refused(&error_chain(&error), &path),
    };
    let actions = match read_actions(&path, start.action_dim()) {
        Ok(actions) => actions,
        Err(error) => return refused(&error_chain(&error), &path),
    };
    let mut replay = Replay::new(&start, &Parameters::default());
    for row in actions.chunks_exact(start.action_dim()).take(N_STEPS) {
        replay.step(row);
        if !replay.world().is_finite() {
            break;
        }
        let _ = replay.record();
    }
    true
}
