//! Runs beside each other, and what is removed when they are over.

use std::path::Path;
use std::time::Duration;

use ipc_types::link::{Domain, HostLane, LinkError, LinkNode};

use crate::scratch::{Scratch, await_signal, create_sim, open_host, small_lane};

#[test]
fn runs_do_not_see_each_other() {
    let (one, two) = (Scratch::new(), Scratch::new());
    let (node, other) = (one.node(), two.node());
    let sim = create_sim(&node, &small_lane(1));
    let stranger = HostLane::open(&other, &small_lane(1), Duration::from_millis(20));
    assert!(matches!(stranger, Err(LinkError::Absent { .. })));
    // Removing one leaves the other whole.
    drop(other);
    two.finish();
    let host = open_host(&node, &small_lane(1));
    drop((sim, host, node));
    one.finish();
}

#[test]
fn a_sweep_removes_the_dead_and_leaves_the_living() {
    let (dead, living, starting) = (Scratch::new(), Scratch::new(), Scratch::new());
    let mut victim = dead.spawn("roles::plays_a_sim_that_is_killed");
    let host = open_host(&dead.node(), &small_lane(1));
    await_signal(&dead.domain.root);
    let mut survivor = living.spawn("roles::plays_a_sim_that_is_killed");
    let living_host = open_host(&living.node(), &small_lane(1));
    await_signal(&living.domain.root);
    // A run whose first process has not joined yet.
    let lease = starting.domain.lease().unwrap();
    // Folders that are not ours, whatever their names.
    std::fs::create_dir(dead.base.path().join("0123456789ab")).unwrap();
    std::fs::write(dead.base.path().join("0123456789ab/thesis.txt"), "").unwrap();
    std::fs::create_dir(dead.base.path().join("images")).unwrap();

    assert_eq!(Domain::remove_stale(dead.base.path()), 0, "a sim lives");
    victim.kill();
    assert_eq!(Domain::remove_stale(dead.base.path()), 0, "a host lives");
    drop(host);
    assert_eq!(Domain::remove_stale(dead.base.path()), 1);
    dead.assert_gone();
    assert!(dead.base.path().join("0123456789ab/thesis.txt").exists());

    drop(living_host);
    assert_eq!(Domain::remove_stale(living.base.path()), 0);
    open_host(&living.node(), &small_lane(1));
    survivor.kill();
    assert_eq!(Domain::remove_stale(living.base.path()), 1);
    living.assert_gone();

    assert_eq!(Domain::remove_stale(starting.base.path()), 0);
    assert!(starting.domain.root.exists());
    drop(lease);
    assert_eq!(Domain::remove_stale(starting.base.path()), 1);
    starting.assert_gone();
    assert_eq!(Domain::remove_stale(&starting.base.path().join("nowhere")), 0);
}

#[test]
fn a_root_too_deep_for_a_socket_is_refused_by_name() {
    let deep = Path::new("/tmp").join("x".repeat(60));
    let error = LinkNode::new(&Domain::new(&deep, 1), "test").unwrap_err();
    assert!(matches!(error, LinkError::Domain { .. }), "{error}");
    assert!(!deep.exists());
}
