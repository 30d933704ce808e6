//! Entry points of the peer processes that other tests spawn from this binary.

use ipc_types::link::{HostLane, LinkNode};

use crate::scratch::{
    LAST_SEQUENCE, TIMEOUT, create_sim, domain_from_env, echo, eventually, mark_ready, receive_observation,
    send, small_lane,
};

#[test]
#[ignore = "other tests start it as a process"]
fn echo_host() {
    let domain = domain_from_env();
    let node = LinkNode::new(&domain, "host").unwrap();
    // The spawning test uses 1 or 2 messages in flight; open the lane with whichever matches.
    let mut lane =
        [1, 2].into_iter().find_map(|in_flight| HostLane::open(&node, &small_lane(in_flight), TIMEOUT).ok());
    let lane = lane.as_mut().unwrap();
    loop {
        let message = receive_observation(lane);
        echo(lane, &message);
        if message.header().sequence == LAST_SEQUENCE {
            break;
        }
    }
}

#[test]
#[ignore = "other tests start it as a process"]
fn host_that_releases_nothing() {
    let domain = domain_from_env();
    let node = LinkNode::new(&domain, "host").unwrap();
    let opened =
        [1, 2].into_iter().find_map(|n| Some((n, HostLane::open(&node, &small_lane(n), TIMEOUT).ok()?)));
    let (in_flight, mut lane) = opened.unwrap();
    let held: Vec<_> = (0..in_flight).map(|_| receive_observation(&mut lane)).collect();
    mark_ready(&domain.root);
    std::thread::sleep(2 * TIMEOUT);
    drop(held);
}

#[test]
#[ignore = "other tests start it as a process"]
fn sim_that_gets_killed() {
    let domain = domain_from_env();
    let node = LinkNode::new(&domain, "sim").unwrap();
    let (_link, mut lane) = create_sim(&node, &small_lane(1));
    eventually("a host attaches", || lane.host_connected().then_some(()));
    send(&mut lane, 1, 1);
    let loan = lane.loan(4).unwrap();
    mark_ready(&domain.root);
    std::thread::sleep(2 * TIMEOUT);
    drop(loan);
}
