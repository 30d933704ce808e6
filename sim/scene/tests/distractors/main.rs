//! Hashes of the objects of every kind, listed in `objects.txt`. A new kind adds a line. A line that changes
//! changes the scenes of old seeds.

use core::fmt::{Debug, Write as _};

use scene::distractors::DistractorKind;
use scene::stream::Stream;
use xxhash_rust::xxh3::xxh3_64;

/// Number of objects per kind, enough to take every branch.
const SEEDS: u64 = 200;

/// Appends an object with all of its shapes, and the next draw of its stream.
fn write_sample(text: &mut String, kind: &DistractorKind, seed: u64) {
    let mut stream = Stream::new(seed, kind.name());
    let object = kind.sample(&mut stream);
    let mut write = |value: &dyn Debug| write!(text, "{value:?} ").expect("a string takes every text");
    for part in &object.parts {
        write(&(&part.shape, part.pose.translation.vector.data.0, part.pose.rotation.coords.data.0));
        write(&part.appearance);
    }
    for visual in &object.visuals {
        write(&(&visual.shape, visual.pose.translation.vector.data.0, visual.pose.rotation.coords.data.0));
        write(&visual.appearance);
    }
    write(&(object.density, object.friction, object.damping, stream.unit()));
}

#[test]
fn objects_keep_their_bytes() {
    let hash = |kind: &DistractorKind| {
        let mut text = String::new();
        (0..SEEDS).for_each(|seed| write_sample(&mut text, kind, seed));
        format!("{:016x} {}", xxh3_64(text.as_bytes()), kind.name())
    };
    let actual: Vec<String> = DistractorKind::all().iter().map(hash).collect();
    let listed: Vec<&str> = include_str!("objects.txt").lines().collect();
    let changed: Vec<_> = actual.iter().filter(|line| !listed.contains(&line.as_str())).collect();
    assert!(changed.is_empty(), "objects.txt lacks {changed:#?}");
    assert_eq!(actual, listed, "kinds and lines of objects.txt are in the same order");
}
