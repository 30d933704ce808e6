//! Isolation of concurrent runs, and removal of stale domains.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;

use ipc_types::link::{Domain, HostLane, LinkError, LinkNode};

use crate::scratch::{Scratch, await_ready, create_sim, open_host, small_lane};

#[test]
fn runs_are_isolated_from_each_other() {
    let (one, two) = (Scratch::new(), Scratch::new());
    let (node, other) = (one.node(), two.node());
    let sim = create_sim(&node, &small_lane(1));
    let stranger = HostLane::open(&other, &small_lane(1), Duration::from_millis(20));
    assert!(matches!(stranger, Err(LinkError::Absent { .. })));
    // Removing one domain leaves the other intact.
    drop(other);
    two.finish();
    let host = open_host(&node, &small_lane(1));
    drop((sim, host, node));
    one.finish();
}

#[test]
fn remove_stale_spares_domains_in_use() {
    let (stale, live, starting) = (Scratch::new(), Scratch::new(), Scratch::new());
    let mut stale_sim = stale.spawn("roles::sim_that_gets_killed");
    let stale_node = stale.node();
    let host = open_host(&stale_node, &small_lane(1));
    await_ready(&stale.domain.root);
    let mut live_sim = live.spawn("roles::sim_that_gets_killed");
    let live_host = open_host(&live.node(), &small_lane(1));
    await_ready(&live.domain.root);
    // A run whose first process has not joined yet.
    let lease = starting.domain.lease().unwrap();
    // Folders that are not domains, even if their names look like one.
    std::fs::create_dir(stale.base.path().join("0123456789ab")).unwrap();
    std::fs::write(stale.base.path().join("0123456789ab/thesis.txt"), "").unwrap();
    std::fs::create_dir(stale.base.path().join("images")).unwrap();

    assert_eq!(Domain::remove_stale(stale.base.path()), 0, "the sim is still running");
    stale_sim.kill();
    assert_eq!(Domain::remove_stale(stale.base.path()), 0, "the host is still attached");
    drop((host, stale_node));
    assert_eq!(Domain::remove_stale(stale.base.path()), 1);
    stale.assert_removed();
    assert!(stale.base.path().join("0123456789ab/thesis.txt").exists());

    drop(live_host);
    assert_eq!(Domain::remove_stale(live.base.path()), 0);
    open_host(&live.node(), &small_lane(1));
    live_sim.kill();
    assert_eq!(Domain::remove_stale(live.base.path()), 1);
    live.assert_removed();

    assert_eq!(Domain::remove_stale(starting.base.path()), 0);
    assert!(starting.domain.root.exists());
    drop(lease);
    assert_eq!(Domain::remove_stale(starting.base.path()), 1);
    starting.assert_removed();
    assert_eq!(Domain::remove_stale(&starting.base.path().join("nowhere")), 0);
}

/// A process leaves an empty root if it is killed after creating it, or before removing it.
#[test]
fn remove_stale_removes_empty_roots() {
    let scratch = Scratch::new();
    std::fs::create_dir(&scratch.domain.root).unwrap();
    assert_eq!(Domain::remove_stale(scratch.base.path()), 1);
    scratch.assert_removed();
    let lease = scratch.domain.lease().unwrap();
    assert_eq!(Domain::remove_stale(scratch.base.path()), 0, "a process holds the lease");
    drop(lease);
    scratch.finish();
}

#[test]
fn node_rejects_root_too_long_for_sockets() {
    let deep = Path::new("/tmp").join("x".repeat(60));
    let error = LinkNode::new(&Domain::new(&deep, 1), "test").unwrap_err();
    assert!(matches!(error, LinkError::Domain { .. }), "{error}");
    assert!(!deep.exists());
}

/// A process that is killed between creating a segment and giving it a size stalls every process that opens
/// it, because iceoryx2 waits for the size without a limit.
#[test]
fn empty_segments_neither_stall_nor_stay() {
    let scratch = Scratch::new();
    let mut sim = scratch.spawn("roles::sim_that_gets_killed");
    let host = open_host(&scratch.node(), &small_lane(1));
    await_ready(&scratch.domain.root);
    sim.kill();
    drop(host);
    for path in scratch.segments() {
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(0).unwrap();
    }
    let (done, reaped) = std::sync::mpsc::channel();
    let domain = scratch.domain.clone();
    std::thread::spawn(move || done.send(domain.reap()));
    let reaped = reaped.recv_timeout(Duration::from_secs(60)).expect("reaping ends");
    assert!(reaped.is_some(), "reaping took too long");
    // The next processes of the domain work as usual.
    let node = scratch.node();
    let sim = create_sim(&node, &small_lane(1));
    let host = open_host(&node, &small_lane(1));
    drop((sim, host, node));
    scratch.finish();
}

/// A sim that is killed between creating and completing the description of a service leaves it writable.
#[test]
fn half_made_services_are_created_anew() {
    let scratch = Scratch::new();
    let mut sim = scratch.spawn("roles::sim_that_gets_killed");
    let host = open_host(&scratch.node(), &small_lane(1));
    await_ready(&scratch.domain.root);
    let services = std::fs::read_dir(scratch.domain.root.join("services")).unwrap();
    let paths: Vec<_> = services.map(|service| service.unwrap().path()).collect();
    assert!(!paths.is_empty());
    sim.kill();
    drop(host);
    for path in paths {
        // What iceoryx2 has cleaned up is half made again.
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, b"{").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
    }
    assert!(scratch.domain.reap().is_some(), "reaping took too long");
    let node = scratch.node();
    let sim = create_sim(&node, &small_lane(1));
    let host = open_host(&node, &small_lane(1));
    drop((sim, host, node));
    scratch.finish();
}

#[test]
fn segments_are_closed_to_other_users() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let sim = create_sim(&node, &small_lane(1));
    let host = open_host(&node, &small_lane(1));
    let segments = scratch.segments();
    assert!(segments.iter().any(|path| path.to_string_lossy().contains("global_mgmt")), "{segments:?}");
    for path in segments {
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0, "{}: {mode:o}", path.display());
    }
    let mode = std::fs::metadata(&scratch.domain.root).unwrap().permissions().mode();
    assert_eq!(mode & 0o077, 0, "{mode:o}");
    drop((sim, host, node));
    scratch.finish();
}

/// A host may hold the services of a sim that has been killed, and leaves them when it notices.
#[test]
fn services_of_an_earlier_sim_do_not_last() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let sim = create_sim(&node, &small_lane(1));
    let host = open_host(&node, &small_lane(1));
    let earlier = Path::new("/dev/shm").join(format!("{}earlier.dynamic", scratch.domain.prefix));
    std::fs::write(&earlier, "").unwrap();
    let lasting = scratch.domain.lasting_files(std::process::id());
    let n_services = lasting.iter().filter(|path| Domain::is_service(path)).count();
    assert!(n_services > 0 && lasting.len() == n_services + 2, "{lasting:?}");
    assert!(!lasting.contains(&earlier) && lasting.iter().all(|path| path.exists()), "{lasting:?}");
    drop((sim, host, node));
    scratch.finish();
}

#[test]
fn unwanted_host_stops_waiting() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let n_asked = std::cell::Cell::new(0);
    let is_wanted = || {
        n_asked.set(n_asked.get() + 1);
        n_asked.get() < 3
    };
    let opened = HostLane::open_while(&node, &small_lane(1), Duration::from_secs(600), &is_wanted);
    assert!(matches!(opened, Err(LinkError::Absent { .. })));
    assert_eq!(n_asked.get(), 3);
    drop(node);
    scratch.finish();
}
