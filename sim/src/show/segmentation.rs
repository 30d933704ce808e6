//! Segmentation colours, the same in every scene of a task: bodies are saturated, the room is muted, and
//! pixels without a surface are black.

use render::Segment;
use scene::Scene;

/// sRGB colours of bodies, in the scene's order (most of S. Trubetskoy, "List of 20 Simple, Distinct Colors",
/// 2017).
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
/// sRGB colours of the arms.
const ARMS: [[u8; 3]; 2] = [[255, 255, 255], [70, 153, 144]];

/// An entry of the segmentation legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LegendEntry {
    /// Name of the object: the body's name within its scene, or `arm 1`, `table` and so on.
    pub name: String,
    /// sRGB colour in images.
    pub color: [u8; 3],
}

/// Returns the sRGB colour of a segment. After the fourteenth body the palette repeats at half the
/// brightness.
pub(crate) fn color_of(segment: Segment) -> [u8; 3] {
    match segment {
        Segment::Nothing => [0; 3],
        Segment::Body(idx) => BODIES[idx % BODIES.len()].map(|c| c >> (idx / BODIES.len()).min(7)),
        Segment::Arm(idx) => ARMS[idx],
        Segment::Table => [205, 170, 125],
        Segment::Floor => [72, 84, 104],
        Segment::Walls => [168, 182, 204],
    }
}

/// Lists all objects that occur in the scenes, without duplicates.
pub(crate) fn legend(scenes: &[Scene]) -> Vec<LegendEntry> {
    let mut entries = Vec::new();
    for entry in scenes.iter().flat_map(entries_of) {
        if !entries.contains(&entry) {
            entries.push(entry);
        }
    }
    entries
}

fn entries_of(scene: &Scene) -> Vec<LegendEntry> {
    let bodies =
        scene.bodies.iter().enumerate().map(|(idx, body)| (body.name.to_owned(), Segment::Body(idx)));
    let arms = (0..scene.robots.len()).map(|idx| (format!("arm {}", idx + 1), Segment::Arm(idx)));
    let walls = scene.background.walls.map(|_| ("walls", Segment::Walls));
    let room = [("table", Segment::Table), ("floor", Segment::Floor)].into_iter().chain(walls);
    let nothing = [("nothing", Segment::Nothing)];
    let room = room.chain(nothing).map(|(name, segment)| (name.to_owned(), segment));
    bodies
        .chain(arms)
        .chain(room)
        .map(|(name, segment)| LegendEntry { name, color: color_of(segment) })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segment_colors_are_distinguishable() {
        let mut segments = vec![Segment::Nothing, Segment::Table, Segment::Floor, Segment::Walls];
        segments.extend((0..2).map(Segment::Arm));
        segments.extend((0..2 * BODIES.len()).map(Segment::Body));
        for (i, &one) in segments.iter().enumerate() {
            for &other in &segments[..i] {
                let (a, b) = (color_of(one), color_of(other));
                let distance: u32 = (0..3).map(|c| u32::from(a[c].abs_diff(b[c]))).sum();
                assert!(distance >= 40, "{one:?} and {other:?} differ by {distance}");
            }
        }
    }
}
