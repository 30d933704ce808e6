//! A message is believed only as far as its header and records fit its memory.

use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::block_pages;
use ipc_types::{
    ActionBlock, ActionHeader, ActionView, EnvRecord, FrameError, Morphology, ObservationHeader,
    ObservationView, Page, SCHEMA_HASH,
};

/// A well-formed message of `n_envs` envs, every byte of whose images is the env's index.
fn observation(morphology: Morphology, images: bool, n_envs: u32) -> (ObservationHeader, Vec<Page>) {
    let block_pages = block_pages(morphology, images);
    let header = ObservationHeader {
        schema_hash: SCHEMA_HASH,
        run: 7,
        sequence: 1,
        epoch: 1,
        n_envs,
        block_pages: block_pages as u32,
        morphology: morphology.code(),
        control_mode: morphology.default_control_mode().code(),
        images: u32::from(images),
        reserved: [0; 2],
    };
    let mut pages = vec![Page::zeroed(); n_envs as usize * block_pages];
    for (env_idx, block) in pages.chunks_exact_mut(block_pages).enumerate() {
        let env = EnvBlockMut::new(morphology, block);
        env.external.fill(env_idx as u8);
        env.hand.fill(0x80 | env_idx as u8);
        env.record.slot = env_idx as u32;
        env.record.execute = 30;
        env.record.state_dim = morphology.state_dim() as u32;
        env.record.state[..morphology.state_dim()].fill(0.5);
        env.record.instruction_len = 3;
        env.record.instruction[..3].copy_from_slice(b"aim");
    }
    (header, pages)
}

/// A well-formed answer for `n_envs` envs.
fn action(n_envs: usize) -> (ActionHeader, Vec<Page>) {
    let header = ActionHeader {
        schema_hash: SCHEMA_HASH,
        run: 7,
        sequence: 1,
        epoch: 1,
        n_envs: n_envs as u32,
        ..ActionHeader::default()
    };
    let mut pages = vec![Page::zeroed(); n_envs];
    for block in bytemuck::cast_slice_mut::<Page, ActionBlock>(&mut pages) {
        (block.n_rows, block.action_dim) = (30, 7);
    }
    (header, pages)
}

#[test]
fn every_tensor_of_a_message_lies_inside_it_and_none_overlap() {
    for (morphology, images) in Morphology::ALL.into_iter().flat_map(|m| [(m, true), (m, false)]) {
        let (header, pages) = observation(morphology, images, 3);
        let view = ObservationView::new(header, &pages).unwrap();
        let mut end = pages.as_ptr().addr();
        for env_idx in 0..view.n_envs() {
            let env = view.env(env_idx);
            assert_eq!(env.record.slot as usize, env_idx);
            assert_eq!((env.state.len(), env.instruction), (morphology.state_dim(), "aim"));
            assert_eq!(env.external.len(), if images { 2 * 224 * 224 * 3 } else { 0 });
            assert_eq!(env.hand.len(), if images { morphology.n_arms() * 128 * 128 * 3 } else { 0 });
            assert!(env.external.iter().all(|&byte| usize::from(byte) == env_idx));
            assert!(env.hand.iter().all(|&byte| usize::from(byte) == 0x80 | env_idx));
            let record = bytemuck::bytes_of(env.record);
            assert!(record.as_ptr_range().contains(&env.state.as_ptr().cast()));
            assert!(record.as_ptr_range().contains(&env.instruction.as_ptr()));
            let tensors = if images { vec![record, env.external, env.hand] } else { vec![record] };
            for tensor in tensors {
                assert!(tensor.as_ptr().addr() >= end, "tensors overlap");
                end = tensor.as_ptr().addr() + tensor.len();
            }
        }
        assert!(end <= pages.as_ptr_range().end.addr());
    }
}

#[test]
fn an_observation_header_that_lies_is_refused() {
    let (good, pages) = observation(Morphology::Single, true, 2);
    assert!(ObservationView::new(good, &pages).is_ok());
    type Lie = fn(&mut ObservationHeader);
    let lies: [(&str, Lie); 12] = [
        ("schema", |h| h.schema_hash ^= 1),
        ("no env", |h| h.n_envs = 0),
        ("one env fewer", |h| h.n_envs = 1),
        ("one env more", |h| h.n_envs = 3),
        ("so many envs that 32 bits overflow", |h| h.n_envs = u32::MAX),
        ("no pages", |h| h.block_pages = 0),
        ("a page fewer", |h| h.block_pages -= 1),
        ("all the pages there could be", |h| h.block_pages = u32::MAX),
        ("the other morphology", |h| h.morphology = 1),
        ("a third morphology", |h| h.morphology = 2),
        ("an unknown control mode", |h| h.control_mode = 3),
        ("two kinds of images", |h| h.images = 2),
    ];
    for (name, lie) in lies {
        let mut header = good;
        lie(&mut header);
        assert!(ObservationView::new(header, &pages).is_err(), "{name} was believed");
    }
    let without_images = ObservationHeader { images: 0, ..good };
    assert!(ObservationView::new(without_images, &pages).is_err(), "missing images were believed");
    assert_eq!(
        ObservationView::new(good, &pages[1..]).unwrap_err(),
        FrameError::Length { expected: 174, found: 173 }
    );
    assert!(ObservationView::new(good, &[]).is_err(), "an empty message was believed");
}

#[test]
fn a_record_that_lies_is_refused() {
    type Lie = (&'static str, fn(&mut EnvRecord));
    let lies: [Lie; 7] = [
        ("more state than the morphology has", |r| r.state_dim = 26),
        ("all the state there could be", |r| r.state_dim = u32::MAX),
        ("a longer instruction than there is room", |r| r.instruction_len = 1025),
        ("all the instruction there could be", |r| r.instruction_len = u32::MAX),
        ("no row to execute", |r| r.execute = 0),
        ("more rows than a chunk can have", |r| r.execute = 64),
        ("half a letter", |r| (r.instruction_len, r.instruction[0]) = (1, 0xc3)),
    ];
    for (name, lie) in lies {
        let (header, mut pages) = observation(Morphology::Single, false, 2);
        lie(bytemuck::cast_mut(&mut pages[1]));
        let Err(error) = ObservationView::new(header, &pages) else { panic!("{name} was believed") };
        assert!(error.to_string().starts_with("env 1"), "{name}: {error}");
    }
}

#[test]
fn an_action_that_lies_is_refused() {
    let (good, pages) = action(2);
    assert_eq!(ActionView::new(good, &pages).unwrap().blocks().len(), 2);
    for n_envs in [0, 1, 3, u32::MAX] {
        assert!(
            ActionView::new(ActionHeader { n_envs, ..good }, &pages).is_err(),
            "{n_envs} envs were believed"
        );
    }
    assert!(ActionView::new(ActionHeader { schema_hash: 0, ..good }, &pages).is_err());
    type Lie = (&'static str, fn(&mut ActionBlock));
    let lies: [Lie; 6] = [
        ("no rows", |b| b.n_rows = 0),
        ("a row more than there is room", |b| b.n_rows = 64),
        ("all the rows there could be", |b| b.n_rows = u32::MAX),
        ("rows of nothing", |b| b.action_dim = 0),
        ("too wide rows", |b| b.action_dim = 17),
        ("rows so wide that the product overflows", |b| b.action_dim = u32::MAX),
    ];
    for (name, lie) in lies {
        let (header, mut pages) = action(2);
        lie(bytemuck::cast_mut(&mut pages[1]));
        let Err(error) = ActionView::new(header, &pages) else { panic!("{name} was believed") };
        assert!(error.to_string().starts_with("env 1"), "{name}: {error}");
    }
}

#[test]
fn one_envs_bad_number_is_found_and_spoils_no_other_env() {
    let (header, mut pages) = action(2);
    let block: &mut ActionBlock = bytemuck::cast_mut(&mut pages[1]);
    // Beyond the last row nothing counts.
    block.rows[7 * 30] = f32::NAN;
    assert_eq!(ActionView::new(header, &pages).unwrap().check_finite(1), Ok(()));
    for number in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        bytemuck::cast_mut::<Page, ActionBlock>(&mut pages[1]).rows[7 * 30 - 1] = number;
        let view = ActionView::new(header, &pages).unwrap();
        assert_eq!(view.check_finite(0), Ok(()));
        assert_eq!(view.check_finite(1), Err(FrameError::NotFinite { env_idx: 1, row: 29, entry: 6 }));
    }
}

#[test]
fn a_policy_that_could_not_answer_sends_no_blocks() {
    let (good, mut pages) = action(2);
    bytemuck::cast_slice_mut::<Page, u8>(&mut pages).fill(0xff);
    let view = ActionView::new(ActionHeader { status: 1, ..good }, &pages).unwrap();
    assert!(view.blocks().is_empty());
    assert!(ActionView::new(good, &pages).is_err());
}

#[test]
#[should_panic(expected = "pages of a bimanual block")]
fn a_block_of_the_wrong_size_is_our_mistake() {
    let mut pages = vec![Page::zeroed(); block_pages(Morphology::Single, true)];
    let _ = EnvBlockMut::new(Morphology::Bimanual, &mut pages);
}
