//! Peers from outside this crate that use iceoryx2 directly and violate the agreed layout.

use std::time::Duration;

use crate::scratch::{
    Scratch, TIMEOUT, create_sim, eventually, open_host, receive_observation, send, small_lane,
};
use iceoryx2::config::Config;
use iceoryx2::prelude::{AttributeVerifier, FileName, NodeBuilder, Path, SemanticString, ipc_threadsafe};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use ipc_types::link::{HostLane, LinkError};
use ipc_types::{ActionHeader, ActionView, FrameError, Page, SCHEMA_HASH};

type Node = iceoryx2::node::Node<ipc_threadsafe::Service>;

/// Creates an iceoryx2 node from the domain's prefix and root alone, without this crate.
fn foreign_node(scratch: &Scratch) -> Node {
    let mut config = Config::default();
    config.global.prefix = FileName::new(scratch.domain.prefix.as_bytes()).unwrap();
    config.global.set_root_path(&Path::new(scratch.domain.root.as_os_str().as_encoded_bytes()).unwrap());
    NodeBuilder::new().config(&config).create().unwrap()
}

#[test]
fn receive_rejects_oversized_message_without_reading_it() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (_link, mut lane) = create_sim(&node, &small_lane(1));
    let foreign = foreign_node(&scratch);
    let actions = foreign
        .service_builder(&"hyp/lane/0/action".try_into().unwrap())
        .publish_subscribe::<[Page]>()
        .user_header::<ActionHeader>()
        .open()
        .unwrap();
    let publisher = actions.publisher_builder().initial_max_slice_len(100).create().unwrap();
    let publish = |n_pages: usize, header: ActionHeader| {
        let sample = publisher.loan_slice_uninit(n_pages).unwrap();
        let mut sample = sample.write_from_fn(|_| Page([0xff; 4096]));
        *sample.user_header_mut() = header;
        sample.send().unwrap();
    };
    publish(100, ActionHeader::default());
    let error = eventually("the error", || lane.receive().err());
    assert!(matches!(error, LinkError::Oversized { pages: 100, max_pages: 8 }), "{error}");

    // The lane still works, and garbage in a message of valid length is reported as an error, not a panic.
    publish(6, ActionHeader { schema_hash: SCHEMA_HASH, n_envs: 3, ..ActionHeader::default() });
    let message = eventually("the message", || lane.receive().unwrap());
    let view = ActionView::new(*message.header(), message.pages());
    assert!(matches!(view, Err(FrameError::Record { env_idx: 0, field: "n_rows", .. })), "{view:?}");
    drop((message, publisher, actions, foreign, lane, _link, node));
    scratch.finish();
}

#[test]
fn open_rejects_lane_with_other_message_types() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let foreign = foreign_node(&scratch);
    let fields = [
        ("schema", format!("{SCHEMA_HASH:016x}")),
        ("lane", "0".into()),
        ("policy", "echo".into()),
        ("max_envs", "4".into()),
        ("block_pages", "1".into()),
        ("in_flight", "1".into()),
    ];
    let attributes = fields.iter().fold(AttributeVerifier::new(), |attributes, (key, value)| {
        let key = AttributeKey::new(key.as_bytes()).unwrap();
        attributes.require(&key, &AttributeValue::new(value.as_bytes()).unwrap()).unwrap()
    });
    let service = foreign
        .service_builder(&"hyp/lane/0/observation".try_into().unwrap())
        .publish_subscribe::<[u64]>()
        .open_or_create_with_attributes(&attributes)
        .unwrap();
    let error = HostLane::open(&node, &small_lane(1), TIMEOUT).unwrap_err();
    assert!(matches!(&error, LinkError::Types { service } if service == "hyp/lane/0/observation"), "{error}");
    drop((service, foreign, node));
    scratch.finish();
}

#[test]
fn host_maps_observations_read_only_without_copy() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (_link, mut lane) = create_sim(&node, &small_lane(1));
    let mut host = open_host(&node, &small_lane(1));
    send(&mut lane, 1, 4);
    let message = receive_observation(&mut host);
    // Both sides map the same memory, the host without write permission.
    let address = message.pages().as_ptr().addr();
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let mapping = maps.lines().find(|line| {
        let range = line.split(' ').next().unwrap();
        let (start, end) = range.split_once('-').unwrap();
        let parse = |digits| usize::from_str_radix(digits, 16).unwrap();
        (parse(start)..parse(end)).contains(&address)
    });
    let mapping = mapping.unwrap();
    assert!(mapping.contains("r--s") && mapping.contains(&scratch.domain.prefix), "{mapping}");
    assert_eq!(address % 4096, 0);
    host.wait(Duration::ZERO).unwrap();
    drop((message, host, lane, _link, node));
    scratch.finish();
}
