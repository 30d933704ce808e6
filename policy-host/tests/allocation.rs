//! Queries allocate nothing after warm-up.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "suite/batch.rs"]
mod batch;

#[path = "../../tests/counting.rs"]
mod counting;

use std::path::PathBuf;

use ipc_types::Morphology;
use policy_host::models::Family;
use policy_host::nn::Precision;
use policy_host::{ActionChunk, PolicySpec, QueryMode, load};

use crate::batch::ObservationBatch;
use crate::counting::allocations;

#[test]
fn query_allocates_nothing_after_warm_up() {
    let folder: PathBuf = [env!("CARGO_MANIFEST_DIR"), "tests/data/act-tiny"].iter().collect();
    for (mode, n_threads) in [(QueryMode::Chunk, 1), (QueryMode::Chunk, 2), (QueryMode::Ensemble, 2)] {
        let mut policy = load(
            &PolicySpec::network(Family::Act, Precision::F32, &folder),
            n_threads,
            mode,
            &Morphology::ALL,
        )
        .unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        let batches = [
            ObservationBatch::of(Morphology::Single, &[0]).executing(2),
            ObservationBatch::of(Morphology::Single, &[1, 2, 3]),
        ];
        assert_eq!(batches[1].answer(&mut *policy).len(), 3);
        let mut answer = vec![ActionChunk::default(); 3];
        let mut round = |policy: &mut dyn policy_host::Policy| {
            for batch in &batches {
                let answer = &mut answer[..batch.header.n_envs as usize];
                policy.act(&batch.view(), answer).unwrap();
            }
        };
        // Like a policy host, run the whole loop inside the pool.
        let ([_, n_allocations], ()) = pool.install(|| {
            (0..5).for_each(|_| round(&mut *policy));
            allocations(|| (0..5).for_each(|_| round(&mut *policy)))
        });
        assert_eq!(n_allocations, 0, "{mode:?}, {n_threads} threads");
    }
}
