//! Shared memory of a lane: its size, its prefaulting, and the budget check that precedes its allocation.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::scratch::{RUN, Scratch, create_sim, open_host};
use ipc_types::ImageSizes;
use ipc_types::layout::block_pages;
use ipc_types::link::{BudgetError, LaneSpec, LinkError, SimLane, check_budget};
use ipc_types::{Morphology, Page};

fn lane_with_images(max_envs: u32) -> LaneSpec {
    let block_pages = block_pages(Morphology::Bimanual, Some(ImageSizes::BENCHMARK)) as u32;
    LaneSpec { lane: 0, policy: "act".into(), max_envs, block_pages, in_flight: 2 }
}

#[test]
fn lane_allocates_its_announced_memory_up_front() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let spec = lane_with_images(8);
    let sim = create_sim(&node, &spec);
    let host = open_host(&node, &spec);
    let allocated: u64 =
        scratch.segments().iter().map(|path| std::fs::metadata(path).unwrap().blocks() * 512).sum();
    let messages = 3 * 8 * u64::from(spec.block_pages) * 4096;
    let announced = spec.shm_bytes();
    assert!(
        allocated >= messages,
        "{allocated} bytes allocated for {messages} bytes of messages: not reserved"
    );
    assert!(allocated <= announced, "{allocated} bytes allocated, {announced} announced");
    assert!(announced - allocated < 1 << 20, "{allocated} bytes allocated, {announced} announced");
    drop((sim, host, node));
    scratch.finish();
}

/// Returns the number of minor page faults of this thread so far (`minflt` in proc(5)).
fn page_faults() -> u64 {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
    let after_name = stat.rsplit_once(')').unwrap().1;
    after_name.split_whitespace().nth(7).unwrap().parse().unwrap()
}

#[test]
fn first_writes_cause_no_page_faults() {
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
    assert!(faults < 50, "{faults} page faults while writing {} pages", 3 * n_pages);
    drop((loans, _link, lane, node));
    scratch.finish();
}

#[test]
fn budget_error_states_needed_and_available_bytes() {
    let (small, huge) = (lane_with_images(2), lane_with_images(1 << 24));
    let shm = Path::new("/dev/shm");
    assert_eq!(check_budget(&[small.clone(), small.clone()], shm).unwrap(), 2 * small.shm_bytes());
    let error = check_budget(&[small.clone(), huge.clone()], shm).unwrap_err();
    let BudgetError::TooSmall { path, needed, available } = &error else { panic!("{error}") };
    assert_eq!((path.as_path(), *needed), (shm, small.shm_bytes() + huge.shm_bytes()));
    assert!(available < needed);
    for part in ["/dev/shm", &needed.to_string(), &available.to_string(), "--envs"] {
        assert!(error.to_string().contains(part), "{error}");
    }
    assert!(matches!(check_budget(&[], Path::new("/nowhere")), Err(BudgetError::Unknown { .. })));
}

#[test]
fn create_allocates_nothing_when_over_budget() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let before = scratch.segments().len();
    let result = SimLane::create(&node, RUN, &lane_with_images(1 << 24));
    assert!(matches!(result, Err(LinkError::Budget(BudgetError::TooSmall { .. }))));
    assert_eq!(scratch.segments().len(), before);
    drop(node);
    scratch.finish();
}

#[test]
fn loan_rejects_sizes_beyond_the_lane() {
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
