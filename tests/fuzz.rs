//! Fuzzing on stable Rust: each target of `harness` with random bytes from a fixed seed, in about a minute.
//!
//! `HYPOGEUM_FUZZ_SEED=N` chooses other bytes, `HYPOGEUM_FUZZ_FACTOR=N` runs N times as many cases, and
//! `HYPOGEUM_FUZZ_CASE=FILE` runs only the bytes in a file. CONTRIBUTING.md says more.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::abort;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use proptest::collection::vec;
use proptest::prelude::any;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner};
use support::harness::{FuzzTarget, TARGETS};

/// Time limit of a case, after which the process aborts.
const CASE_TIMEOUT: Duration = Duration::from_secs(60);
/// Maximum size of one allocation in bytes. The largest input has less than 1 MB.
const MAX_ALLOCATION: usize = 64 << 20;
/// Maximum number of bytes of a case.
const MAX_CASE_BYTES: usize = 128;

/// Size of the largest allocation of the current case.
static LARGEST: AtomicUsize = AtomicUsize::new(0);
/// One case at a time, so that its largest allocation is known.
static TURN: Mutex<()> = Mutex::new(());

struct Measuring;

// SAFETY: every call is forwarded to the system allocator unchanged; updating the maximum does not allocate.
unsafe impl GlobalAlloc for Measuring {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller upholds the contract of `GlobalAlloc::alloc`, which is forwarded as it is.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as in `alloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: as in `alloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as in `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Measuring = Measuring;

/// Returns a number from the environment, or a default.
fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text}")))
}

/// Runs the target `name` with random bytes. A failure names the smallest failing case that was found.
#[track_caller]
fn fuzz(name: &str) {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let target = TARGETS.iter().find(|target| target.name == name).unwrap();
    if let Some(path) = std::env::var_os("HYPOGEUM_FUZZ_CASE") {
        run_case(target, &std::fs::read(path).unwrap());
        return;
    }
    assert!(run_case(target, &[]), "a valid input is accepted");
    let n_accepted = Cell::new(0_u32);
    let (seed, factor) = (number("HYPOGEUM_FUZZ_SEED", 1), number("HYPOGEUM_FUZZ_FACTOR", 1));
    let cases = target.n_cases.saturating_mul(u32::try_from(factor).unwrap());
    let config = Config { cases, max_shrink_iters: 300, failure_persistence: None, ..Config::default() };
    let rng_seed: Vec<u8> = seed.to_le_bytes().repeat(4);
    let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &rng_seed));
    let found = runner.run(&vec(any::<u8>(), 0..MAX_CASE_BYTES), |case| {
        LARGEST.store(0, Ordering::Relaxed);
        n_accepted.set(n_accepted.get() + u32::from(run_case(target, &case)));
        let largest = LARGEST.load(Ordering::Relaxed);
        if largest <= MAX_ALLOCATION {
            Ok(())
        } else {
            Err(TestCaseError::fail(format!("an allocation of {largest} bytes")))
        }
    });
    match found {
        Ok(()) => {
            let share = f64::from(n_accepted.get()) / f64::from(cases);
            assert!((0.02..0.98).contains(&share), "{share} of the inputs are accepted");
        }
        Err(TestError::Abort(reason)) => panic!("{reason}"),
        Err(TestError::Fail(reason, case)) => {
            let path = case_file(name);
            std::fs::write(&path, &case).unwrap();
            panic!("{reason}\nThe case is in {}; seed {seed}.", path.display())
        }
    }
}

/// Returns the file of the last case of a target. After a crash of the process, it contains the reason.
fn case_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz-{name}.case"))
}

/// Runs a case and returns `true` if its input is accepted. If it takes too long, the process aborts.
fn run_case(target: &FuzzTarget, case: &[u8]) -> bool {
    let path = case_file(target.name);
    std::fs::write(&path, case).unwrap();
    let (ends, ended) = channel::<()>();
    let name = target.name;
    let watch = std::thread::spawn(move || {
        if ended.recv_timeout(CASE_TIMEOUT) == Err(RecvTimeoutError::Timeout) {
            let _ = writeln!(std::io::stderr(), "{name}: the case in {} takes too long", path.display());
            abort();
        }
    });
    let result = std::panic::catch_unwind(|| (target.run)(case));
    drop(ends);
    watch.join().unwrap();
    result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

#[test]
fn damaged_checkpoints_are_refused() {
    fuzz("checkpoint");
}

#[test]
fn damaged_frames_are_refused() {
    fuzz("frame");
}

#[test]
fn damaged_paraphrases_are_refused() {
    fuzz("language");
}

#[test]
fn damaged_protocol_lines_are_refused() {
    fuzz("protocol");
}

#[test]
fn damaged_results_files_are_refused() {
    fuzz("results");
}

#[test]
fn damaged_sweeps_are_refused() {
    fuzz("sweep");
}

#[test]
fn damaged_tables_are_refused() {
    fuzz("tables");
}

#[test]
fn damaged_tokenizers_are_refused() {
    fuzz("tokenizer");
}

#[test]
fn damaged_trajectories_are_refused() {
    fuzz("trajectory");
}

/// Found by fuzzing: resampling took time and memory in proportion to the largest episode index.
#[test]
fn episode_indices_may_be_huge() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.db");
    orchestrator::fuzzing::write_results(&path);
    let sql = "UPDATE episodes SET episode = 4294967295 - episode";
    rusqlite::Connection::open(&path).unwrap().execute(sql, []).unwrap();
    orchestrator::fuzzing::seal_results(&path);
    LARGEST.store(0, Ordering::Relaxed);
    assert_eq!(orchestrator::fuzzing::read_results(&path, folder.path()), Ok(144));
    assert!(LARGEST.load(Ordering::Relaxed) < MAX_ALLOCATION);
}

/// Found by fuzzing: a curve far beyond its axis made the drawing of the page overflow.
#[test]
fn first_success_may_be_beyond_the_horizon() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.db");
    orchestrator::fuzzing::write_results(&path);
    let sql = "UPDATE episodes SET first_success_step = 100000";
    rusqlite::Connection::open(&path).unwrap().execute(sql, []).unwrap();
    orchestrator::fuzzing::seal_results(&path);
    assert_eq!(orchestrator::fuzzing::read_results(&path, folder.path()), Ok(144));
}

#[test]
fn every_target_is_known_to_cargo_fuzz() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz");
    let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
    for FuzzTarget { name, .. } in TARGETS {
        let text = std::fs::read_to_string(folder.join(format!("fuzz_targets/{name}.rs"))).unwrap();
        assert!(text.contains(&format!("harness::{name}::run(data)")), "{text}");
        assert!(manifest.contains(&format!("path = \"fuzz_targets/{name}.rs\"")), "{name}");
    }
    let n_files = std::fs::read_dir(folder.join("fuzz_targets")).unwrap().count();
    assert_eq!(n_files, TARGETS.len());
}
