//! A sample's actions do not depend on the batch it is in, nor on the number of threads.

use ipc_types::Morphology;
use policy_host::{Policy, PolicySpec, QueryMode, load};

use crate::batch::Batch;
use crate::{data, rows};

fn policy(n_threads: usize) -> Box<dyn Policy> {
    load(&PolicySpec::Act(data("act-tiny")), n_threads, QueryMode::Chunk).unwrap()
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
        let alone: Vec<_> = (0..n_envs)
            .map(|env| bits(rows(&Batch::of(morphology, &[env]).answer(&mut *policy(1))[0])))
            .collect();
        assert_ne!(alone[0], alone[1], "different observations have different actions");
        for n_threads in [1, 2, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let mut policy = policy(n_threads);
            for envs in batches {
                let answer = pool.install(|| Batch::of(morphology, envs).answer(&mut *policy));
                for (&env, block) in envs.iter().zip(&answer) {
                    assert_eq!((block.slot, block.query), (env, 0));
                    assert_eq!(
                        bits(rows(block)),
                        alone[env as usize],
                        "env {env} in {envs:?}, {n_threads} threads"
                    );
                }
            }
        }
    }
}
