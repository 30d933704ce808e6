//! Validation of messages: headers and records must be consistent with the memory they arrive in.

use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::{ACTION_PAGES, MAX_HORIZON, block_pages};
use ipc_types::{
    ActionBlock, ActionHeader, ActionView, EnvRecord, FrameError, ImageSize, ImageSizes, Morphology,
    ObservationHeader, ObservationView, Page, SCHEMA_HASH,
};

/// Sizes that no benchmark has.
const ODD: ImageSizes =
    ImageSizes { external: ImageSize { width: 99, height: 65 }, hand: ImageSize { width: 64, height: 81 } };

/// Returns a valid message of `n_envs` envs. All bytes of an env's external images are the env's index, those
/// of its hand images the index with the high bit set.
fn observation(
    morphology: Morphology,
    images: Option<ImageSizes>,
    n_envs: u32,
) -> (ObservationHeader, Vec<Page>) {
    let header = ObservationHeader {
        schema_hash: SCHEMA_HASH,
        run: 7,
        sequence: 1,
        epoch: 1,
        n_envs,
        control_mode: morphology.default_control_mode().code(),
        ..ObservationHeader::default()
    }
    .with_images(morphology, images);
    let block_pages = header.block_pages as usize;
    let mut pages = vec![Page::zeroed(); n_envs as usize * block_pages];
    for (env_idx, block) in pages.chunks_exact_mut(block_pages).enumerate() {
        let env = EnvBlockMut::new(morphology, images, block);
        env.record.slot = env_idx as u32;
        env.record.execute = 30;
        env.record.state_dim = morphology.state_dim() as u32;
        env.record.state[..morphology.state_dim()].fill(0.5);
        env.record.instruction_len = 3;
        env.record.instruction[..3].copy_from_slice(b"aim");
        for (camera_idx, image) in env.images().enumerate() {
            let is_hand = camera_idx >= morphology.n_external_cameras();
            image.fill(env_idx as u8 | if is_hand { 0x80 } else { 0 });
        }
    }
    (header, pages)
}

/// Returns a valid action message for `n_envs` envs.
fn action(n_envs: usize) -> (ActionHeader, Vec<Page>) {
    let header = ActionHeader {
        schema_hash: SCHEMA_HASH,
        run: 7,
        sequence: 1,
        epoch: 1,
        n_envs: n_envs as u32,
        ..ActionHeader::default()
    };
    let mut pages = vec![Page::zeroed(); n_envs * ACTION_PAGES];
    for block in bytemuck::cast_slice_mut::<Page, ActionBlock>(&mut pages) {
        (block.n_rows, block.action_dim) = (30, 7);
    }
    (header, pages)
}

#[test]
fn tensors_lie_inside_the_message_without_overlap() {
    let images = [None, Some(ImageSizes::BENCHMARK), Some(ODD)];
    for (morphology, images) in Morphology::ALL.into_iter().flat_map(|m| images.map(|images| (m, images))) {
        let (header, pages) = observation(morphology, images, 3);
        let view = ObservationView::new(header, &pages).unwrap();
        let mut end = pages.as_ptr().addr();
        for env_idx in 0..view.n_envs() {
            let env = view.env(env_idx);
            assert_eq!(env.record.slot as usize, env_idx);
            assert_eq!((env.state.len(), env.instruction), (morphology.state_dim(), "aim"));
            assert_eq!(env.external.len(), images.map_or(0, |sizes| 2 * sizes.external.n_bytes()));
            assert_eq!(env.hand.len(), images.map_or(0, |sizes| morphology.n_arms() * sizes.hand.n_bytes()));
            assert_eq!(env.images().count(), images.map_or(0, |_| morphology.camera_names().len()));
            assert!(env.external.iter().all(|&byte| usize::from(byte) == env_idx));
            assert!(env.hand.iter().all(|&byte| usize::from(byte) == 0x80 | env_idx));
            let record = bytemuck::bytes_of(env.record);
            assert!(record.as_ptr_range().contains(&env.state.as_ptr().cast()));
            assert!(record.as_ptr_range().contains(&env.instruction.as_ptr()));
            let tensors = if images.is_some() { vec![record, env.external, env.hand] } else { vec![record] };
            for tensor in tensors {
                assert!(tensor.as_ptr().addr() >= end, "tensors overlap");
                end = tensor.as_ptr().addr() + tensor.len();
            }
        }
        assert!(end <= pages.as_ptr_range().end.addr());
    }
}

#[test]
fn inconsistent_observation_header_is_rejected() {
    let (good, pages) = observation(Morphology::Single, Some(ImageSizes::BENCHMARK), 2);
    assert!(ObservationView::new(good, &pages).is_ok());
    type Corrupt = fn(&mut ObservationHeader);
    let cases: [(&str, Corrupt); 15] = [
        ("wrong schema hash", |h| h.schema_hash ^= 1),
        ("zero envs", |h| h.n_envs = 0),
        ("one env too few", |h| h.n_envs = 1),
        ("one env too many", |h| h.n_envs = 3),
        ("env count that overflows 32 bits", |h| h.n_envs = u32::MAX),
        ("zero block pages", |h| h.block_pages = 0),
        ("one block page too few", |h| h.block_pages -= 1),
        ("maximum block pages", |h| h.block_pages = u32::MAX),
        ("the other morphology", |h| h.morphology = 1),
        ("unknown morphology", |h| h.morphology = 2),
        ("unknown control mode", |h| h.control_mode = 3),
        ("invalid image flag", |h| h.images = 2),
        ("images without sizes", |h| h.image_sizes = [0; 4]),
        ("other images than its pages hold", |h| h.image_sizes[3] += 64),
        ("images beyond the limit", |h| h.image_sizes[0] = 1281),
    ];
    for (name, corrupt) in cases {
        let mut header = good;
        corrupt(&mut header);
        assert!(ObservationView::new(header, &pages).is_err(), "{name} was accepted");
    }
    let without_images = ObservationHeader { images: 0, ..good };
    assert!(ObservationView::new(without_images, &pages).is_err(), "a cleared image flag was accepted");
    assert_eq!(
        ObservationView::new(good, &pages[1..]).unwrap_err(),
        FrameError::Length { expected: 174, found: 173 }
    );
    assert!(ObservationView::new(good, &[]).is_err(), "an empty message was accepted");
}

#[test]
fn inconsistent_record_is_rejected() {
    type Case = (&'static str, fn(&mut EnvRecord));
    let cases: [Case; 7] = [
        ("state wider than the morphology's", |r| r.state_dim = 26),
        ("maximum state width", |r| r.state_dim = u32::MAX),
        ("instruction longer than its field", |r| r.instruction_len = 1025),
        ("maximum instruction length", |r| r.instruction_len = u32::MAX),
        ("zero rows to execute", |r| r.execute = 0),
        ("more rows to execute than a chunk holds", |r| r.execute = MAX_HORIZON as u32 + 1),
        ("truncated UTF-8 sequence", |r| (r.instruction_len, r.instruction[0]) = (1, 0xc3)),
    ];
    for (name, corrupt) in cases {
        let (header, mut pages) = observation(Morphology::Single, None, 2);
        corrupt(&mut bytemuck::cast_slice_mut(&mut pages)[1]);
        let Err(error) = ObservationView::new(header, &pages) else { panic!("{name} was accepted") };
        assert!(error.to_string().starts_with("env 1"), "{name}: {error}");
    }
}

#[test]
fn inconsistent_action_message_is_rejected() {
    let (good, pages) = action(2);
    assert_eq!(ActionView::new(good, &pages).unwrap().blocks().len(), 2);
    for n_envs in [0, 1, 3, u32::MAX] {
        assert!(
            ActionView::new(ActionHeader { n_envs, ..good }, &pages).is_err(),
            "{n_envs} envs were accepted"
        );
    }
    assert!(ActionView::new(ActionHeader { schema_hash: 0, ..good }, &pages).is_err());
    type Case = (&'static str, fn(&mut ActionBlock));
    let cases: [Case; 6] = [
        ("zero rows", |b| b.n_rows = 0),
        ("one row too many", |b| b.n_rows = MAX_HORIZON as u32 + 1),
        ("maximum row count", |b| b.n_rows = u32::MAX),
        ("zero row width", |b| b.action_dim = 0),
        ("row width beyond the limit", |b| b.action_dim = 17),
        ("row width that overflows the product", |b| b.action_dim = u32::MAX),
    ];
    for (name, corrupt) in cases {
        let (header, mut pages) = action(2);
        corrupt(&mut bytemuck::cast_slice_mut(&mut pages)[1]);
        let Err(error) = ActionView::new(header, &pages) else { panic!("{name} was accepted") };
        assert!(error.to_string().starts_with("env 1"), "{name}: {error}");
    }
}

#[test]
fn check_finite_reports_only_the_affected_env() {
    let (header, mut pages) = action(2);
    let block = &mut bytemuck::cast_slice_mut::<Page, ActionBlock>(&mut pages)[1];
    // Values beyond the last row are ignored.
    block.rows[7 * 30] = f32::NAN;
    assert_eq!(ActionView::new(header, &pages).unwrap().check_finite(1), Ok(()));
    for number in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        bytemuck::cast_slice_mut::<Page, ActionBlock>(&mut pages)[1].rows[7 * 30 - 1] = number;
        let view = ActionView::new(header, &pages).unwrap();
        assert_eq!(view.check_finite(0), Ok(()));
        assert_eq!(view.check_finite(1), Err(FrameError::NotFinite { env_idx: 1, row: 29, entry: 6 }));
    }
}

#[test]
fn failed_status_yields_no_blocks() {
    let (good, mut pages) = action(2);
    bytemuck::cast_slice_mut::<Page, u8>(&mut pages).fill(0xff);
    let view = ActionView::new(ActionHeader { status: 1, ..good }, &pages).unwrap();
    assert!(view.blocks().is_empty());
    assert!(ActionView::new(good, &pages).is_err());
}

#[test]
#[should_panic(expected = "pages of a bimanual block")]
fn env_block_of_wrong_size_panics() {
    let mut pages = vec![Page::zeroed(); block_pages(Morphology::Single, Some(ImageSizes::BENCHMARK))];
    let _ = EnvBlockMut::new(Morphology::Bimanual, Some(ImageSizes::BENCHMARK), &mut pages);
}

#[test]
fn checksum_covers_every_byte_of_a_message() {
    let (header, mut pages) = observation(Morphology::Single, None, 1);
    let checked = header.with_checksum(&pages);
    assert_eq!(checked.check_checksum(&pages), Ok(()));
    for byte in 0..size_of::<ObservationHeader>() {
        let mut changed = checked;
        bytemuck::bytes_of_mut(&mut changed)[byte] ^= 0x10;
        assert!(changed.check_checksum(&pages).is_err(), "byte {byte} of the header");
    }
    for byte in 0..size_of::<Page>() {
        pages[0].0[byte] ^= 0x10;
        let error = checked.check_checksum(&pages).unwrap_err();
        assert!(matches!(error, FrameError::Checksum { .. }), "byte {byte}: {error}");
        pages[0].0[byte] ^= 0x10;
    }
    let error = header.check_checksum(&pages).unwrap_err();
    assert!(error.to_string().contains("has_checksum"), "{error}");
}

/// The Python package has the same test with the same number, computed by zlib.
#[test]
fn checksum_is_that_of_zlib() {
    let header = ObservationHeader {
        schema_hash: 1,
        run: 2,
        sequence: 3,
        epoch: 4,
        n_envs: 1,
        block_pages: 1,
        ..ObservationHeader::default()
    };
    let page = Page(std::array::from_fn(|i| i as u8));
    assert_eq!(header.with_checksum(&[page]).checksum, 0x95C9_7948);
}
