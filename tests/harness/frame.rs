//! Messages of the link: headers and pages that a foreign host or a faulty peer could send.

use std::ops::Range;

use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::ACTION_PAGES;
use ipc_types::{
    ActionBlock, ActionHeader, ActionView, ControlMode, EnvRecord, ImageSize, ImageSizes, Morphology,
    ObservationHeader, ObservationView, Page, SCHEMA_HASH,
};
use policy_host::{ActionChunk, PolicySpec, QueryMode, load};

use super::edits::Edits;
use super::refused_in_one_line;

/// Validates an observation or an action message, and uses everything in it if it is valid.
///
/// # Panics
/// If an error is unclear, or a slice lies outside the message.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    if edits.below(2) == 0 { observation(&mut edits) } else { action(&mut edits) }
}

fn observation(edits: &mut Edits<'_>) -> bool {
    let (mut header, mut pages) = valid_observation(edits);
    for _ in 0..edits.below(4) {
        edit_words(edits, bytemuck::bytes_of_mut(&mut header));
    }
    edit_pages(edits, &mut pages);
    match ObservationView::new(header, &pages) {
        Ok(view) => {
            check_observation(&view, &pages, edits);
            true
        }
        Err(error) => refused_in_one_line(&error.to_string()),
    }
}

fn action(edits: &mut Edits<'_>) -> bool {
    let n_envs = edits.below(4);
    let mut header = ActionHeader {
        schema_hash: SCHEMA_HASH,
        n_envs: n_envs as u32,
        status: edits.below(2) as u32,
        ..ActionHeader::default()
    };
    let mut pages = vec![Page::zeroed(); n_envs * ACTION_PAGES];
    for block in bytemuck::cast_slice_mut::<Page, ActionBlock>(&mut pages) {
        (block.n_rows, block.action_dim) = (30, 7);
    }
    for _ in 0..edits.below(3) {
        edit_words(edits, bytemuck::bytes_of_mut(&mut header));
    }
    edit_pages(edits, &mut pages);
    let view = match ActionView::new(header, &pages) {
        Ok(view) => view,
        Err(error) => return refused_in_one_line(&error.to_string()),
    };
    assert!(view.blocks().is_empty() || view.blocks().len() == view.header().n_envs as usize);
    for (env_idx, block) in view.blocks().iter().enumerate() {
        let rows = &block.rows[..block.n_rows as usize * block.action_dim as usize];
        assert!(!rows.is_empty());
        let is_finite = rows.iter().all(|x| x.is_finite());
        match view.check_finite(env_idx) {
            Ok(()) => assert!(is_finite),
            Err(error) => assert!(!is_finite && !error.to_string().is_empty()),
        }
    }
    true
}

/// Returns a valid message of up to three envs.
pub(crate) fn valid_observation(edits: &mut Edits<'_>) -> (ObservationHeader, Vec<Page>) {
    let morphology = *edits.pick(&Morphology::ALL);
    let control_mode = *edits.pick(&ControlMode::ALL);
    let small = ImageSizes { external: ImageSize { width: 65, height: 64 }, hand: ImageSize::MIN };
    let images = *edits.pick(&[None, None, None, Some(small)]);
    let n_envs = 1 + edits.below(3);
    let header = ObservationHeader {
        schema_hash: SCHEMA_HASH,
        n_envs: n_envs as u32,
        control_mode: control_mode.code(),
        ..ObservationHeader::default()
    }
    .with_images(morphology, images);
    let block_pages = header.block_pages as usize;
    let mut pages = vec![Page::zeroed(); n_envs * block_pages];
    for (env_idx, block) in pages.chunks_exact_mut(block_pages).enumerate() {
        let env = EnvBlockMut::new(morphology, images, block);
        env.external.fill(env_idx as u8);
        env.record.slot = env_idx as u32;
        env.record.execute = 30;
        env.record.state_dim = morphology.state_dim() as u32;
        env.record.state[..morphology.state_dim()].fill(0.5);
        env.record.instruction_len = 3;
        env.record.instruction[..3].copy_from_slice(b"aim");
    }
    (header, pages)
}

/// Changes the number of pages, and fields and bytes of the first ones of each block.
fn edit_pages(edits: &mut Edits<'_>, pages: &mut Vec<Page>) {
    match edits.below(6) {
        1 => drop(pages.pop()),
        2 => pages.push(Page::zeroed()),
        3 => pages.clear(),
        _ => {}
    }
    for _ in 0..edits.below(4) {
        if !pages.is_empty() {
            let page = edits.below(pages.len());
            // The numbers in the head of a record, or all of it.
            let len = if edits.below(2) == 0 { 32 } else { size_of::<EnvRecord>() };
            edit_words(edits, &mut pages[page].0[..len]);
        }
    }
}

/// Overwrites a number of 4 or 8 bytes.
fn edit_words(edits: &mut Edits<'_>, bytes: &mut [u8]) {
    let number = edits.number().to_le_bytes();
    let len = if edits.below(2) == 0 { 4 } else { 8 };
    let at = edits.below(bytes.len() / len) * len;
    bytes[at..at + len].copy_from_slice(&number[..len]);
}

fn check_observation(view: &ObservationView<'_>, pages: &[Page], edits: &mut Edits<'_>) {
    let message = pages.as_ptr_range();
    let message = message.start.cast::<u8>()..message.end.cast::<u8>();
    for env_idx in 0..view.n_envs() {
        let env = view.env(env_idx);
        assert!(contains(&message, bytemuck::cast_slice(env.state)));
        assert!(contains(&message, env.instruction.as_bytes()));
        assert!(contains(&message, env.external) && contains(&message, env.hand));
        assert!(env.state.len() <= view.morphology().state_dim());
        for (image, size) in env.images() {
            assert!(contains(&message, image) && size.is_supported());
            assert_eq!(image.len(), size.n_bytes());
        }
    }
    let policies = [(PolicySpec::Idle, QueryMode::Chunk), (PolicySpec::Random, QueryMode::Ensemble)];
    let (spec, mode) = edits.pick(&policies);
    let mut policy = load(spec, 1, *mode, &Morphology::ALL).unwrap();
    let mut answer = vec![ActionChunk::default(); view.n_envs()];
    match policy.act(view, &mut answer) {
        Ok(()) => assert!(answer.iter().all(|chunk| !chunk.rows().is_empty())),
        Err(error) => assert!(!refused_in_one_line(&error.to_string())),
    }
}

fn contains(message: &Range<*const u8>, slice: &[u8]) -> bool {
    let slice = slice.as_ptr_range();
    slice.is_empty() || (message.start <= slice.start && slice.end <= message.end)
}
