//! Observation messages with generated values, identical to those that `python/make_act_checkpoint.py` passes
//! to PyTorch.

use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::{
    ActionBlock, EnvRecord, ImageSizes, Morphology, ObservationHeader, ObservationView, Page, SCHEMA_HASH,
};
use policy_host::generated::{fnv1a64, sym, unit};
use policy_host::{ActionChunk, Policy};

/// Instructions of even and odd envs.
const INSTRUCTIONS: [&str; 2] = ["Raise the red cube above the table.", ""];
/// Side of the uniform blocks in a generated hand image, in pixels.
const HAND_BLOCK: usize = 8;

/// An observation message and its header.
pub(crate) struct ObservationBatch {
    pub(crate) header: ObservationHeader,
    pub(crate) pages: Vec<Page>,
}

impl ObservationBatch {
    /// Creates the observations of these envs. Env `n` has the same observation in every batch.
    pub(crate) fn of(morphology: Morphology, envs: &[u32]) -> Self {
        let images = Some(ImageSizes::BENCHMARK);
        let header = ObservationHeader {
            schema_hash: SCHEMA_HASH,
            run: 1,
            sequence: 1,
            n_envs: envs.len() as u32,
            control_mode: morphology.default_control_mode().code(),
            ..ObservationHeader::zeroed()
        }
        .with_images(morphology, images);
        let block_len = header.block_pages as usize;
        let mut pages = vec![Page::zeroed(); block_len * envs.len()];
        for (&env, block) in envs.iter().zip(pages.chunks_exact_mut(block_len)) {
            fill(morphology, env, EnvBlockMut::new(morphology, images, block));
        }
        Self { header, pages }
    }

    /// Asks for this number of rows of every chunk in place of 30.
    pub(crate) fn executing(mut self, n_rows: u32) -> Self {
        for block in self.pages.chunks_exact_mut(self.header.block_pages as usize) {
            let record: &mut EnvRecord = bytemuck::cast_mut(&mut block[0]);
            record.execute = n_rows;
        }
        self
    }

    pub(crate) fn view(&self) -> ObservationView<'_> {
        ObservationView::new(self.header, &self.pages).unwrap()
    }

    /// Returns the action blocks that `policy` computes for this batch.
    pub(crate) fn answer(&self, policy: &mut dyn Policy) -> Vec<ActionBlock> {
        let view = self.view();
        let mut chunks = vec![ActionChunk::default(); view.n_envs()];
        policy.act(&view, &mut chunks).unwrap();
        let mut answer = vec![ActionBlock::zeroed(); view.n_envs()];
        for (env_idx, (chunk, block)) in chunks.iter().zip(&mut answer).enumerate() {
            chunk.write(view.env(env_idx).record, block);
        }
        answer
    }
}

fn fill(morphology: Morphology, env: u32, block: EnvBlockMut<'_>) {
    let stream = |part: &str| fnv1a64(&format!("in.{env}.{part}"));
    let byte = |stream, idx| (256.0 * unit(stream, idx)) as u8;
    let external = stream("external");
    let hand_side = ImageSizes::BENCHMARK.hand.width;
    block.external.iter_mut().enumerate().for_each(|(idx, x)| *x = byte(external, idx));
    let (hand, blocks_per_row) = (stream("hand"), hand_side / HAND_BLOCK);
    for (idx, x) in block.hand.iter_mut().enumerate() {
        let (channel, col, row, map) =
            (idx % 3, idx / 3 % hand_side, idx / 3 / hand_side % hand_side, idx / 3 / hand_side / hand_side);
        let row = map * blocks_per_row + row / HAND_BLOCK;
        *x = byte(hand, (row * blocks_per_row + col / HAND_BLOCK) * 3 + channel);
    }
    let record = block.record;
    let (instruction, state) = (INSTRUCTIONS[env as usize % 2], stream("state"));
    record.slot = env;
    record.execute = 30;
    record.policy_seed = u64::from(env) + 100;
    record.state_dim = morphology.state_dim() as u32;
    let numbers = record.state[..morphology.state_dim()].iter_mut().enumerate();
    numbers.for_each(|(idx, x)| *x = sym(state, idx, 1.0));
    record.instruction_len = instruction.len() as u32;
    record.instruction[..instruction.len()].copy_from_slice(instruction.as_bytes());
}
