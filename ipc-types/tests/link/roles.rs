//! The parts that other tests have this binary play in a process of its own. Run by hand they do nothing.

use ipc_types::link::{HostLane, LinkNode};

use crate::scratch::{
    LAST, PATIENCE, create_sim, echo, eventually, receive_observation, send, signal, small_lane, told_domain,
};

#[test]
#[ignore = "a part that another test plays"]
fn plays_a_host() {
    let Some(domain) = told_domain() else { return };
    let node = LinkNode::new(&domain, "host").unwrap();
    // In flight: what the sim of the test that is playing has set.
    let mut lane =
        [1, 2].into_iter().find_map(|in_flight| HostLane::open(&node, &small_lane(in_flight), PATIENCE).ok());
    let lane = lane.as_mut().unwrap();
    loop {
        let message = receive_observation(lane);
        echo(lane, &message);
        if message.header().sequence == LAST {
            return;
        }
    }
}

#[test]
#[ignore = "a part that another test plays"]
fn plays_a_host_that_keeps_everything() {
    let Some(domain) = told_domain() else { return };
    let node = LinkNode::new(&domain, "hoarder").unwrap();
    let opened =
        [1, 2].into_iter().find_map(|n| Some((n, HostLane::open(&node, &small_lane(n), PATIENCE).ok()?)));
    let (in_flight, mut lane) = opened.unwrap();
    let kept: Vec<_> = (0..in_flight).map(|_| receive_observation(&mut lane)).collect();
    signal(&domain.root);
    std::thread::sleep(2 * PATIENCE);
    drop(kept);
}

#[test]
#[ignore = "a part that another test plays"]
fn plays_a_sim_that_is_killed() {
    let Some(domain) = told_domain() else { return };
    let node = LinkNode::new(&domain, "sim").unwrap();
    let (_link, mut lane) = create_sim(&node, &small_lane(1));
    eventually("a host attaches", || lane.host_connected().then_some(()));
    send(&mut lane, 1, 1);
    let loan = lane.loan(4).unwrap();
    signal(&domain.root);
    std::thread::sleep(2 * PATIENCE);
    drop(loan);
}
