//! A colour for every thing, the same in every scene of a task: bodies bright, the room dull, nothing black.

use crate::render::Segment;
use crate::scene::Scene;

/// Of bodies, in the scene's order (most of "20 simple, distinct colors", S. Trubetskoy, 2017).
const BODIES: [[u8; 3]; 14] = [
    [230, 25, 75],
    [60, 180, 75],
    [255, 225, 25],
    [67, 99, 216],
    [245, 130, 49],
    [145, 30, 180],
    [66, 212, 244],
    [240, 50, 230],
    [191, 239, 69],
    [250, 190, 212],
    [154, 99, 36],
    [170, 255, 195],
    [128, 0, 0],
    [0, 0, 117],
];
/// Of arms.
const ARMS: [[u8; 3]; 2] = [[255, 255, 255], [70, 153, 144]];

/// A line of the legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The body's name within its scene, `arm 1`, `table` and so on.
    pub name: String,
    /// sRGB.
    pub color: [u8; 3],
}

/// sRGB of a thing. Bodies after the fourteenth begin the colours again, darker by half for every round.
pub(super) fn color_of(segment: Segment) -> [u8; 3] {
    match segment {
        Segment::Nothing => [0; 3],
        Segment::Body(idx) => BODIES[idx % BODIES.len()].map(|c| c >> (idx / BODIES.len()).min(7)),
        Segment::Arm(idx) => ARMS[idx],
        Segment::Table => [205, 170, 125],
        Segment::Floor => [72, 84, 104],
        Segment::Walls => [168, 182, 204],
    }
}

/// What the scenes may show, each thing once.
pub(super) fn legend(scenes: &[Scene]) -> Vec<Entry> {
    let mut entries = Vec::new();
    for entry in scenes.iter().flat_map(things) {
        if !entries.contains(&entry) {
            entries.push(entry);
        }
    }
    entries
}

fn things(scene: &Scene) -> Vec<Entry> {
    let bodies =
        scene.bodies.iter().enumerate().map(|(idx, body)| (body.name.to_owned(), Segment::Body(idx)));
    let arms = (0..scene.robots.len()).map(|idx| (format!("arm {}", idx + 1), Segment::Arm(idx)));
    let walls = scene.background.walls.map(|_| ("walls", Segment::Walls));
    let room = [("table", Segment::Table), ("floor", Segment::Floor)].into_iter().chain(walls);
    let nothing = [("nothing", Segment::Nothing)];
    let room = room.chain(nothing).map(|(name, segment)| (name.to_owned(), segment));
    bodies.chain(arms).chain(room).map(|(name, segment)| Entry { name, color: color_of(segment) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_things_look_alike() {
        let mut things = vec![Segment::Nothing, Segment::Table, Segment::Floor, Segment::Walls];
        things.extend((0..2).map(Segment::Arm));
        things.extend((0..2 * BODIES.len()).map(Segment::Body));
        for (i, &one) in things.iter().enumerate() {
            for &other in &things[..i] {
                let (a, b) = (color_of(one), color_of(other));
                let distance: u32 = (0..3).map(|c| u32::from(a[c].abs_diff(b[c]))).sum();
                assert!(distance >= 40, "{one:?} and {other:?} differ by {distance}");
            }
        }
    }
}
