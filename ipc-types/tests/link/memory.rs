//! Shared memory: what a lane takes, and that it is asked for before it is taken.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::scratch::{RUN, Scratch, create_sim, open_host};
use ipc_types::layout::block_pages;
use ipc_types::link::{BudgetError, LaneSpec, LinkError, SimLane, check_budget};
use ipc_types::{Morphology, Page};

fn lane_with_images(max_envs: u32) -> LaneSpec {
    let block_pages = block_pages(Morphology::Bimanual, true) as u32;
    LaneSpec { lane: 0, policy: "act".into(), max_envs, block_pages, in_flight: 2 }
}

#[test]
fn a_lane_takes_what_it_said_before_the_first_message() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let spec = lane_with_images(8);
    let sim = create_sim(&node, &spec);
    let host = open_host(&node, &spec);
    let taken: u64 =
        scratch.segments().iter().map(|path| std::fs::metadata(path).unwrap().blocks() * 512).sum();
    let messages = 3 * 8 * u64::from(spec.block_pages) * 4096;
    assert!(taken >= messages, "{taken} bytes taken for {messages} bytes of messages: not populated");
    assert!(taken <= spec.shm_bytes(), "{taken} bytes taken, {} announced", spec.shm_bytes());
    assert!(spec.shm_bytes() - taken < 1 << 20, "{taken} bytes taken, {} announced", spec.shm_bytes());
    drop((sim, host, node));
    scratch.finish();
}

/// Page faults of this thread so far.
fn page_faults() -> u64 {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
    let after_name = stat.rsplit_once(')').unwrap().1;
    after_name.split_whitespace().nth(7).unwrap().parse().unwrap()
}

#[test]
fn the_first_writing_of_a_lane_touches_no_new_memory() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let spec = lane_with_images(8);
    let (_link, mut lane) = create_sim(&node, &spec);
    let n_pages = 8 * spec.block_pages as usize;
    let mut loans: Vec<_> = (0..3).map(|_| lane.loan(n_pages).unwrap()).collect();
    let before = page_faults();
    for loan in &mut loans {
        bytemuck::cast_slice_mut::<Page, u8>(loan.pages_mut()).fill(7);
    }
    let faults = page_faults() - before;
    assert!(faults < 50, "{faults} page faults while {} pages were written", 3 * n_pages);
    drop((loans, _link, lane, node));
    scratch.finish();
}

#[test]
fn too_many_envs_are_refused_with_the_numbers() {
    let (one, two) = (lane_with_images(2), lane_with_images(1 << 24));
    assert_eq!(
        check_budget(&[one.clone(), one.clone()], Path::new("/dev/shm")).unwrap(),
        2 * one.shm_bytes()
    );
    let error = check_budget(&[one.clone(), two.clone()], Path::new("/dev/shm")).unwrap_err();
    let BudgetError::TooSmall { path, needed, available } = &error else { panic!("{error}") };
    assert_eq!((path.as_path(), *needed), (Path::new("/dev/shm"), one.shm_bytes() + two.shm_bytes()));
    assert!(available < needed);
    for part in ["/dev/shm", &needed.to_string(), &available.to_string(), "--envs"] {
        assert!(error.to_string().contains(part), "{error}");
    }
    assert!(matches!(check_budget(&[], Path::new("/nowhere")), Err(BudgetError::Unknown { .. })));
}

#[test]
fn a_lane_that_does_not_fit_takes_nothing() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let before = scratch.segments().len();
    let refused = SimLane::create(&node, RUN, &lane_with_images(1 << 24));
    assert!(matches!(refused, Err(LinkError::Budget(BudgetError::TooSmall { .. }))));
    assert_eq!(scratch.segments().len(), before);
    drop(node);
    scratch.finish();
}

#[test]
fn a_message_longer_than_the_lane_is_not_loaned() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (_link, mut lane) = create_sim(&node, &lane_with_images(2));
    for pages in [0, 2 * 99 + 1, usize::MAX] {
        assert!(matches!(lane.loan(pages), Err(LinkError::LoanSize { max_pages: 198, .. })));
    }
    assert_eq!(lane.loan(198).unwrap().pages_mut().len(), 198);
    drop((_link, lane, node));
    scratch.finish();
}
