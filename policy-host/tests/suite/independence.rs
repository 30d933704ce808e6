//! A sample's actions do not depend on the batch it is in, nor on the number of threads.

use ipc_types::{EnvRecord, Morphology};
use policy_host::{Policy, PolicySpec, QueryMode, load};

use crate::batch::Batch;
use crate::{data, rows};

/// In floats and in eight bits.
fn policies(n_threads: usize) -> [Box<dyn Policy>; 2] {
    [PolicySpec::Act(data("act-tiny")), PolicySpec::ActInt8(data("act-tiny"))]
        .map(|spec| load(&spec, n_threads, QueryMode::Chunk).unwrap())
}

/// Not finite numbers are refused by the simulator, env by env.
#[test]
fn an_env_whose_numbers_explode_changes_no_bit_of_its_neighbours() {
    let envs = Batch::of(Morphology::Single, &[0, 1, 2, 3, 4]);
    let mut batch = Batch::of(Morphology::Single, &[0, 1, 2, 3, 4]);
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
fn actions_are_the_same_bits_alone_and_in_a_batch_on_one_thread_and_on_more() {
    let few = [&[2][..], &[3, 1], &[4, 3, 2, 1, 0]];
    let many: Vec<u32> = (0..33).rev().collect();
    let batches = [(Morphology::Bimanual, &few[..]), (Morphology::Single, &[&[7, 6], &many[9..17], &many])];
    for (morphology, batches) in batches {
        let n_envs = batches.iter().copied().flatten().max().map_or(0, |&env| env + 1);
        let alone = policies(1).map(|mut policy| -> Vec<_> {
            let answer = |env| Batch::of(morphology, &[env]).answer(&mut *policy);
            (0..n_envs).map(answer).map(|answer| bits(rows(&answer[0]))).collect()
        });
        assert_ne!(alone[0][0], alone[0][1], "different observations have different actions");
        assert_ne!(alone[0], alone[1], "eight bits are fewer");
        for n_threads in [1, 2, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            for (mut policy, alone) in policies(n_threads).into_iter().zip(&alone) {
                for envs in batches {
                    let answer = pool.install(|| Batch::of(morphology, envs).answer(&mut *policy));
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
