//! Agreement with the original: its own demonstrations, executed here from the same start states.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use sim::Profile;
use sim::physics::{BodyState, Parameters};
use sim::trajectory::{Replay, Start, TrajectoryFile, read_actions};

/// Environment, recordings that must succeed at any time and at the end, and the maximum mean distance of the
/// TCPs in mm. RotateArrow counts as in the released code. All recordings but one of `DualArmStack3Cube`
/// end in success in the original.
const EXPECTED: [(&str, [usize; 2], f64); 17] = [
    ("DualArmLiftPot-v1", [3, 3], 0.6),
    ("DualArmLiftTray-v1", [3, 3], 0.9),
    ("DualArmPenCap-v1", [3, 3], 2.5),
    ("DualArmPickCube-v1", [3, 3], 0.3),
    ("DualArmPourPot-v1", [3, 3], 3.0),
    ("DualArmPushBox-v1", [3, 3], 0.7),
    // Cubes dropped from 8 cm land differently (docs/differences.md).
    ("DualArmStack3Cube-v1", [0, 0], 0.6),
    ("DualArmStackCube-v1", [3, 1], 0.2),
    ("DualArmThreading-v1", [3, 3], 0.5),
    ("LiftPegUprightColosseumV2-v1", [3, 3], 0.3),
    ("PegInsertionSideColosseumV2-v1", [3, 3], 0.4),
    ("PickDishFromRack-v1", [3, 3], 1.5),
    ("PlaceDishInRack-v1", [3, 3], 0.2),
    ("PlugChargerColosseumV2-v1", [3, 3], 0.5),
    ("RaiseCube-v1", [3, 3], 0.1),
    ("RotateArrow-v1", [3, 3], 0.2),
    ("StackCubeColosseumV2-v1", [3, 3], 0.1),
];

fn recordings() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/trajectories");
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Executes a recording. Returns whether it succeeded at any time and at the end, and the mean distance of
/// the TCPs in mm.
fn execute(path: &Path) -> ([bool; 2], f64) {
    let mut file = TrajectoryFile::read(path).unwrap();
    let recorded = file.recorded.take().unwrap();
    if file.task.starts_with("RotateArrow") {
        file.profile = Profile::Paper;
    }
    let start = Start::resolve(&file, path).unwrap();
    let actions = read_actions(path, start.action_dim()).unwrap();
    let mut replay = Replay::new(&start, &Parameters::default());
    let (mut once, mut at_end, mut distances) = (false, false, Vec::new());
    for (row, tcps) in actions.chunks_exact(start.action_dim()).zip(&recorded.tcp) {
        replay.step(row);
        at_end = replay.unmet().is_none();
        once |= at_end;
        for (arm, tcp) in tcps.iter().enumerate() {
            let position = replay.world().tcp_pose(arm).translation.vector.cast::<f64>();
            distances.push(1e3 * (position - Vector3::from(*tcp)).norm());
        }
    }
    ([once, at_end], distances.iter().sum::<f64>() / distances.len() as f64)
}

#[test]
fn recorded_demonstrations_of_the_original_succeed() {
    let files = recordings();
    for (environment, min_successes, max_mm) in EXPECTED {
        let of_environment = |path: &&PathBuf| {
            let name = path.file_stem().unwrap().to_str().unwrap();
            name.rsplit_once('.').unwrap().0 == environment
        };
        let outcomes: Vec<([bool; 2], f64)> =
            files.iter().filter(of_environment).map(|it| execute(it)).collect();
        let n_successes = [0, 1].map(|when| outcomes.iter().filter(|(succeeded, _)| succeeded[when]).count());
        let mean = outcomes.iter().map(|(_, mm)| mm).sum::<f64>() / outcomes.len() as f64;
        let enough = n_successes.iter().zip(min_successes).all(|(n, min)| *n >= min);
        assert!(enough, "{environment}: {n_successes:?} of {} at any time and at the end", outcomes.len());
        assert!(mean <= max_mm, "{environment}: the TCPs are {mean:.2} mm apart on average");
    }
}

/// A change to the JSON of a start.
type Edit = fn(&mut serde_json::Value);

/// Returns the error for a recording after `edit` changed its JSON.
fn error_after(edit: impl FnOnce(&mut serde_json::Value)) -> String {
    let path = recordings().into_iter().find(|path| path.ends_with("RaiseCube-v1.0.json")).unwrap();
    let mut json = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    edit(&mut json);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("start.json");
    std::fs::write(&path, json.to_string()).unwrap();
    let error = TrajectoryFile::read(&path)
        .and_then(|file| Start::resolve(&file, &path))
        .and_then(|start| read_actions(&path, start.action_dim()))
        .unwrap_err();
    let source = std::error::Error::source(&error).map_or(String::new(), |source| format!(": {source}"));
    format!("{error}{source}").replace(path.to_str().unwrap(), "start.json")
}

#[test]
fn wrong_values_are_named_with_their_key() {
    let cases: [(Edit, &str); 14] = [
        (|json| json["task"] = "RaiseCub".into(), "start.json: task: expected the name of a task"),
        (|json| json["control_mode"] = "pd".into(), "control_mode: expected one of pd_ee_delta_pose"),
        (|json| json["sizes"] = vec![1.0].into(), "sizes: expected nothing, found [1.0]"),
        (|json| json["arms"] = serde_json::json!([]), "arms: expected 1, found 0"),
        (
            |json| json["bodies"]["ball"] = json["bodies"]["cube"].clone(),
            "bodies: expected only cube, found ball",
        ),
        (|json| json["bodies"]["cube"]["pose"][3] = 2.0.into(), "bodies.cube: expected a unit quaternion"),
        (
            |json| json["arms"][0]["qpos"][0] = 23.0.into(),
            "arms[0].qpos[0]: expected numbers from -2.9973 to 2.9973 rad, found 23 (in degrees?)",
        ),
        (|json| json["arms"][0]["qpos"][3] = 1.0.into(), "qpos[3]: expected numbers from -3.1718"),
        (
            |json| json["arms"][0]["qpos"][8] = 20.0.into(),
            "qpos[8]: expected numbers from -0.01 to 0.05 m, found 20 (in millimetres?)",
        ),
        (
            |json| json["arms"][0]["qvel"] = vec![0.0, 1e19, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].into(),
            "qvel[1]: expected numbers from -100 to 100 rad/s",
        ),
        (
            |json| json["bodies"]["cube"]["pose"][1] = 50.0.into(),
            "bodies.cube: expected numbers from -10 to 10 m for the position, found 50 (in millimetres?)",
        ),
        (
            |json| json["bodies"]["cube"]["linear_velocity"] = vec![0.0, 0.0, -1e9].into(),
            "bodies.cube: expected numbers from -100 to 100 m/s, found -1000000000",
        ),
        (
            |json| json["bodies"]["cube"]["angular_velocity"] = vec![1e4, 0.0, 0.0].into(),
            "bodies.cube: expected numbers from -1000 to 1000 rad/s, found 10000",
        ),
        (|json| json["actions"][4] = vec![0.0; 7].into(), "actions[4]: expected 8 numbers, found 7"),
    ];
    for (edit, expected) in cases {
        let error = error_after(edit);
        assert!(error.contains(expected), "{error}");
    }
    let error = error_after(|json| json["arms"][0]["qpos"] = vec![0.0; 8].into());
    assert!(error.contains("is not a trajectory") && error.contains("invalid length 8"), "{error}");
}

#[test]
fn state_read_and_set_again_is_the_same() {
    for path in recordings().iter().step_by(5) {
        let file = TrajectoryFile::read(path).unwrap();
        let start = Start::resolve(&file, path).unwrap();
        let actions = read_actions(path, start.action_dim()).unwrap();
        let mut replay = Replay::new(&start, &Parameters::default());
        actions.chunks_exact(start.action_dim()).take(60).for_each(|row| replay.step(row));
        let state = replay.world().state();
        let mut world = start.world(&Parameters::default());
        world.set_state(&state);
        let again = world.state();
        for (arm, expected) in again.arms.iter().zip(&state.arms) {
            let differences = arm.qpos.iter().zip(&expected.qpos).map(|(a, b)| (a - b).abs());
            assert!(differences.fold(0.0, f32::max) < 1e-6, "{}", path.display());
            assert_eq!(arm.qvel, expected.qvel);
        }
        for (body, expected) in again.bodies.iter().zip(&state.bodies) {
            let moved = (body.pose.translation.vector - expected.pose.translation.vector).norm();
            let turned = body.pose.rotation.angle_to(&expected.pose.rotation);
            assert!(moved < 1e-6 && turned < 1e-3, "{}: {moved} m, {turned} rad", path.display());
            let velocities = |state: &BodyState| (state.linear_velocity, state.angular_velocity);
            assert_eq!(velocities(body), velocities(expected));
        }
    }
}
