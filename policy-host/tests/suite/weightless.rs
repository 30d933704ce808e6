//! The weight-free policies: idle and random.

use ipc_types::{ControlMode, EnvRecord, Morphology};
use policy_host::{ActionChunk, Policy, PolicyError, PolicySpec, QueryMode, load};

use crate::batch::ObservationBatch;
use crate::rows;

fn policy(name: &str) -> Box<dyn Policy> {
    load(&name.parse().unwrap(), 1, QueryMode::Chunk, &Morphology::ALL).unwrap()
}

/// Creates the observation of one env that requests `execute` rows. Joint `j` of arm `a` is at `j + a/10`
/// rad, the fingers of arm `a` are at `finger_m · (a + 1)`.
fn batch(morphology: Morphology, finger_m: f32, step: u32, execute: u32) -> ObservationBatch {
    let mut batch = ObservationBatch::of(morphology, &[3]);
    let record: &mut EnvRecord = bytemuck::cast_mut(&mut batch.pages[0]);
    let n_arms = morphology.n_arms();
    for joint in 0..9 {
        for arm in 0..n_arms {
            record.state[joint * n_arms + arm] =
                if joint < 7 { joint as f32 + arm as f32 / 10.0 } else { finger_m * (arm + 1) as f32 };
        }
    }
    (record.step, record.execute) = (step, execute);
    batch
}

#[test]
fn idle_holds_tool_and_gripper_position() {
    for (finger_m, command) in [(-0.01, -1.0), (0.015, 0.0), (0.04, 1.0), (0.05, 1.0)] {
        let answer = batch(Morphology::Single, finger_m, 0, 4).answer(&mut *policy("idle"));
        assert_eq!((answer[0].n_rows, answer[0].action_dim), (4, 7));
        for row in rows(&answer[0]).chunks(7) {
            assert_eq!(row[..6], [0.0; 6]);
            assert!((row[6] - command).abs() < 1e-6, "{finger_m} m: {}", row[6]);
        }
    }
}

#[test]
fn idle_reads_each_arm_from_interleaved_state() {
    let answer = batch(Morphology::Bimanual, 0.02, 0, 1).answer(&mut *policy("idle"));
    let expected = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.2, 0.1, 1.1, 2.1, 3.1, 4.1, 5.1, 6.1, 1.0];
    for (entry, (x, y)) in rows(&answer[0]).iter().zip(expected).enumerate() {
        assert!((x - y).abs() < 1e-5, "entry {entry}: {x}, not {y}");
    }
}

/// Found by fuzzing: a peer may send any step.
#[test]
fn last_step_number_is_answered() {
    for name in ["idle", "random"] {
        let answer = batch(Morphology::Single, 0.02, u32::MAX, 3).answer(&mut *policy(name));
        assert_eq!(answer[0].n_rows, 3, "{name}");
    }
}

#[test]
fn random_depends_on_episode_not_on_chunking() {
    let all = batch(Morphology::Single, 0.02, 10, 6).answer(&mut *policy("random"));
    let later = batch(Morphology::Single, 0.02, 12, 2).answer(&mut *policy("random"));
    assert_eq!(rows(&all[0])[2 * 7..4 * 7], *rows(&later[0]));
    assert!(rows(&all[0]).iter().all(|x| (-1.0..=1.0).contains(x)));
    assert_ne!(rows(&all[0])[..7], rows(&all[0])[7..14]);

    let mut other = batch(Morphology::Single, 0.02, 10, 6);
    bytemuck::cast_mut::<_, EnvRecord>(&mut other.pages[0]).policy_seed += 1;
    assert_ne!(rows(&other.answer(&mut *policy("random"))[0]), rows(&all[0]));
}

#[test]
fn random_is_uniform() {
    let samples: Vec<f32> = (0..20)
        .flat_map(|chunk| {
            rows(&batch(Morphology::Single, 0.02, chunk * 60, 60).answer(&mut *policy("random"))[0]).to_vec()
        })
        .collect();
    let mean = |f: &dyn Fn(f32) -> f32| samples.iter().map(|&x| f(x)).sum::<f32>() / samples.len() as f32;
    assert_eq!(samples.len(), 8400);
    assert!(mean(&|x| x).abs() < 0.03 && (mean(&|x| x * x) - 1.0 / 3.0).abs() < 0.02);
}

#[test]
fn random_joints_stay_near_measured_ones() {
    let answer = batch(Morphology::Bimanual, 0.02, 0, 63).answer(&mut *policy("random"));
    let mut max_offset: f32 = 0.0;
    for row in rows(&answer[0]).chunks(16) {
        for (arm, action) in row.chunks(8).enumerate() {
            for (joint, x) in action[..7].iter().enumerate() {
                max_offset = max_offset.max((x - (joint as f32 + arm as f32 / 10.0)).abs());
            }
            assert!(action[7].abs() <= 1.0);
        }
    }
    assert!(max_offset <= 0.0501 && max_offset > 0.03, "{max_offset}");
}

#[test]
fn unsupported_requests_are_rejected() {
    for name in ["idle", "random"] {
        let mut absolute = batch(Morphology::Single, 0.0, 0, 1);
        absolute.header.control_mode = ControlMode::EePose.code();
        let error = policy(name).act(&absolute.view(), &mut [ActionChunk::default()]).unwrap_err();
        assert!(matches!(error, PolicyError::Unsupported { control_mode: "pd_ee_pose", .. }), "{error}");
    }
    let error = load(&PolicySpec::Expert, 1, QueryMode::Chunk, &Morphology::ALL).err().unwrap().to_string();
    assert_eq!(error, "policy `expert` does not run in a policy host");
}
