//! Actions of a sample do not depend on its batch or on the number of threads.

use ipc_types::{EnvRecord, Morphology};
use policy_host::models::Family;
use policy_host::nn::Precision;
use policy_host::{Policy, PolicySpec, QueryMode, load};

use crate::batch::ObservationBatch;
use crate::{act_spec, data, rows};

/// Loads the policy in f32 and with 8-bit integers.
fn policies(n_threads: usize) -> [Box<dyn Policy>; 2] {
    [act_spec(data("act-tiny")), PolicySpec::network(Family::Act, Precision::Int8, data("act-tiny"))]
        .map(|spec| load(&spec, n_threads, QueryMode::Chunk, &Morphology::ALL).unwrap())
}

/// The simulator rejects non-finite values per env.
#[test]
fn non_finite_env_does_not_affect_other_envs() {
    let envs = ObservationBatch::of(Morphology::Single, &[0, 1, 2, 3, 4]);
    let mut batch = ObservationBatch::of(Morphology::Single, &[0, 1, 2, 3, 4]);
    let block_pages = batch.header.block_pages as usize;
    for env in [1, 4] {
        let record: &mut EnvRecord = bytemuck::cast_mut(&mut batch.pages[env * block_pages]);
        record.state[3] = f32::INFINITY;
    }
    for mut policy in policies(2) {
        let whole = envs.answer(&mut *policy);
        for (env, (found, expected)) in batch.answer(&mut *policy).iter().zip(&whole).enumerate() {
            if [1, 4].contains(&env) {
                assert!(rows(found).iter().all(|x| x.is_nan()), "env {env}");
            } else {
                assert_eq!(bits(rows(found)), bits(rows(expected)), "env {env}");
            }
        }
    }
}

fn bits(rows: &[f32]) -> Vec<u32> {
    rows.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn actions_do_not_depend_on_batch_or_threads() {
    let few = [&[2][..], &[3, 1], &[4, 3, 2, 1, 0]];
    let many: Vec<u32> = (0..33).rev().collect();
    let batches = [(Morphology::Bimanual, &few[..]), (Morphology::Single, &[&[7, 6], &many[9..17], &many])];
    for (morphology, batches) in batches {
        let n_envs = batches.iter().copied().flatten().max().map_or(0, |&env| env + 1);
        let alone = policies(1).map(|mut policy| -> Vec<_> {
            let answer = |env| ObservationBatch::of(morphology, &[env]).answer(&mut *policy);
            (0..n_envs).map(answer).map(|answer| bits(rows(&answer[0]))).collect()
        });
        assert_ne!(alone[0][0], alone[0][1], "different observations must give different actions");
        assert_ne!(alone[0], alone[1], "the precisions must differ");
        for n_threads in [1, 2, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            for (mut policy, alone) in policies(n_threads).into_iter().zip(&alone) {
                for envs in batches {
                    let answer = pool.install(|| ObservationBatch::of(morphology, envs).answer(&mut *policy));
                    for (&env, block) in envs.iter().zip(&answer) {
                        assert_eq!((block.slot, block.query), (env, 0));
                        let place = format!("env {env} in {envs:?}, {n_threads} threads");
                        assert_eq!(bits(rows(block)), alone[env as usize], "{place}");
                    }
                }
            }
        }
    }
}

/// Only the rows that the sim will execute are computed, unless all are asked for. They are the first rows of
/// the whole chunk.
#[test]
fn executed_rows_do_not_depend_on_their_number() {
    for morphology in Morphology::ALL {
        for envs in [&[0][..], &[0, 1], &[0, 1, 2, 3, 4]] {
            for mut policy in policies(2) {
                let whole = ObservationBatch::of(morphology, envs).answer(&mut *policy);
                for n_rows in [1, 2, 5] {
                    let few = ObservationBatch::of(morphology, envs).executing(n_rows).answer(&mut *policy);
                    for (few, whole) in few.iter().zip(&whole) {
                        assert!(n_rows < whole.n_rows, "the whole chunk has {} rows", whole.n_rows);
                        assert_eq!(few.n_rows, n_rows);
                        assert_eq!(bits(rows(few)), bits(&rows(whole)[..rows(few).len()]));
                    }
                }
                policy.compute_whole_chunks();
                let all = ObservationBatch::of(morphology, envs).executing(1).answer(&mut *policy);
                for (all, whole) in all.iter().zip(&whole) {
                    assert_eq!(bits(rows(all)), bits(rows(whole)));
                }
            }
        }
    }
}
